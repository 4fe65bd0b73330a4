"""A segmenter that learns from surveys: fruits that many photos confirm teach it those that it missed."""
