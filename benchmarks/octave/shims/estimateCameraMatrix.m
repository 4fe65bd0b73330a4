% Camera matrix (4 x 3), [x y z 1] * P = w [u v 1], that fits image points (n x 2) and world points (n x 3) best.
% Direct linear transformation with normalised coordinates (Hartley and Zisserman 2004, algorithm 7.1), w > 0.
function P = estimateCameraMatrix (image_points, world_points)
  n = size (world_points, 1);
  A = normalising (image_points);
  B = normalising (world_points);
  uv = [image_points, ones(n, 1)] * A';
  X = [world_points, ones(n, 1)] * B';
  zero = zeros (n, 4);
  [~, ~, V] = svd ([X, zero, -uv(:, 1) .* X; zero, X, -uv(:, 2) .* X], "econ");
  M = A \ reshape (V(:, end), 4, 3)' * B;
  w = [world_points, ones(n, 1)] * M(3, :)';
  P = (M * sign (median (w)) / norm (M(3, 1:3)))';
end

function T = normalising (points)
  d = columns (points);
  middle = mean (points, 1);
  s = sqrt (d) / mean (sqrt (sum ((points - middle) .^ 2, 2)));
  T = eye (d + 1);
  T(1:d, 1:d) *= s;
  T(1:d, end) = -s * middle';
end
