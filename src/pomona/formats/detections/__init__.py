"""Fruits drawn or found in photos, in the files of other programs: COCO, VIA, LabelMe, YOLO, images of ids and more."""
