"""`pomona app`: surveys on this computer, made, watched and looked at in a page."""
