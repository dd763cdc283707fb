"""Where rendering runs.

The server never imports Mitsuba: a scene that crashes takes a render process down, not it.
"""
