"""Built-in scenes, made in code: no files to ship but their thumbnails, and nothing of Mitsuba at import."""

from .catalogue import find, list_scenes
from .gallery_scene import GalleryScene

__all__ = ["GalleryScene", "find", "list_scenes"]
