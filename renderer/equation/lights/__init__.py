"""Sampling of lights: the area form.

`scene_lights.py` sorts the lights of a scene into groups, each sampled in one way (`group.py`: what a group can do):
`environment_map.py`, `uniform_lights.py`, `surface_lights.py`, `collimated_lights.py`, and `plugin_lights.py` for all
others. `choice.py` chooses one among all of them: by power (`powers.py`), or by what a `survey.py` has seen each give
where (`place_tree.py`). `sampler.py` puts them together: it is what a kernel asks. `check.py` looks for light that a
group misses.
"""
