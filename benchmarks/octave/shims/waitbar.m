% No window.
function handle = waitbar (varargin)
  handle = [];
end
