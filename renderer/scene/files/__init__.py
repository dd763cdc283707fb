"""What is in the files that a scene names, from their headers and vertices, before Mitsuba loads them."""
