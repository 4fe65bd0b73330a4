"""What several stages know of fruits: their kinds and usual size, spheres and outlines, crops of photos about them."""
