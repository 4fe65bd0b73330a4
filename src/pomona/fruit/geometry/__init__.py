"""Masks as viewing rays, fruits as spheres, and what one looks like in photos or a cloud."""
