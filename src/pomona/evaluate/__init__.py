"""How good the results are: fruits in space, detections in photos, and a diagnosis of what went wrong."""
