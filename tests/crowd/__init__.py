"""`make crowd`: a service among hostile clients."""
