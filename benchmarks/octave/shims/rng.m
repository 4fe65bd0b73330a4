% Random numbers from a seed.
function rng (seed)
  rand ("twister", seed);
  randn ("twister", seed);
end
