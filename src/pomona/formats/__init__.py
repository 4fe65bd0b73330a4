"""Files of other programs: COCO, COLMAP, LAS, PLY, CSV, GeoJSON."""
