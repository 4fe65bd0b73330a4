"""What is known of fruits before they are measured: kind, usual size, how far they are, colours, classes of size."""
