% Convex hull of points (n x 3) and its volume: MATLAB's boundary with a shrink factor of 0.
function [facets, volume] = boundary (points, shrink)
  facets = [];
  volume = 0;
  if rows (points) > 3 && rank (points - mean (points, 1)) == 3
    [facets, volume] = convhulln (points);
  end
end
