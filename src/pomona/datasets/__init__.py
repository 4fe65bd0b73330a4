"""Public datasets: found on disk, run through Pomona's stages, and our figures set beside the printed ones."""
