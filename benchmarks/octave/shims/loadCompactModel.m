% The authors' support vector machine is a MATLAB object, which Octave cannot read: no fruit is taken for a false one.
function model = loadCompactModel (file)
  model = struct ();
end
