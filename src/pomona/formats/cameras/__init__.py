"""Cameras of other programs: one module a format, all of them in `registry`; `read` finds and reads them."""
