"""What the Learn view shows: each step from the rendering equation to a picture, computed by the renderer itself.

`pixel` is an estimator at the first vertex of one pixel; `bounces` its radiance by the number of reflections; `walk`
one path, vertex by vertex; `two_forms` the integral over directions beside that over the lights; `one_dimension` and
`expression` the estimator itself, of any function that is typed in.
"""
