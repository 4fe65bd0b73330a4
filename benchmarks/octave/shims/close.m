% No window to close.
function close (varargin)
end
