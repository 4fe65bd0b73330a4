"""What any room may use and knows nothing of fruits: arrays, transforms, options, threads, networks in files."""
