% MATLAB's writematrix (matrix, file, 'delimiter', '\t').
function writematrix (matrix, file, varargin)
  dlmwrite (file, matrix, "delimiter", "\t", "precision", "%.10g");
end
