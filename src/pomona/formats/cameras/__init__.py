"""Cameras of other programs: one module a format; `recognise` tells which it is and reads it."""
