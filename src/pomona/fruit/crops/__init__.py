"""Crops of photos about fruits, which are equally wide in all: what small networks look at."""
