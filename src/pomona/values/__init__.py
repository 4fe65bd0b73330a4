"""The values that flow from stage to stage: frozen dataclasses of arrays whose shapes are checked."""
