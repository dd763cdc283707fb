"""The command line: one module for each command. It knows the renderer and the service; neither knows it."""
