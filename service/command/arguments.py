"""How what is typed is read: errors, times, sizes, regions, ranges. Anything else is refused by the option's name."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from renderer.camera import Camera
from renderer.errors import SettingsError, check_name
from renderer.region import Region
from renderer.series import product


def parse_error(text: str, option: str = "--error") -> float:
    """'2%' or '0.02' as a fraction."""
    found = re.fullmatch(r"\s*([0-9.eE+-]+)\s*(%?)\s*", text)
    try:
        return float(found.group(1)) / (100 if found.group(2) else 1)  # type: ignore[union-attr]
    except (AttributeError, ValueError):
        raise SettingsError(f"{option} is {text!r}; write it as 2% or 0.02") from None


def parse_time(text: str) -> float:
    """'90', '90s', '1.5m', '1h' or '1m30s' in seconds."""
    units = {"": 1.0, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0}
    parts = re.findall(r"([0-9.]+)\s*(min|[smh]?)", text.strip())
    rebuilt = "".join(f"{n}{u}" for n, u in parts)
    try:
        if not parts or any(not unit for _, unit in parts[:-1]) or rebuilt != text.replace(" ", ""):
            raise ValueError
        return sum(float(n) * units[u] for n, u in parts)
    except ValueError:
        raise SettingsError(f"--time is {text!r}; write it as 30s, 1m30s or 2h") from None


def parse_size(text: str) -> tuple[int, int]:
    """'640x480' as (640, 480)."""
    found = re.fullmatch(r"\s*(\d+)\s*[x×X]\s*(\d+)\s*", text)
    if not found:
        raise SettingsError(
            f"--size is {text!r}; write it as WIDTHxHEIGHT, for example 640x480, or give --width or --height alone"
        )
    return int(found.group(1)), int(found.group(2))


def sides(size: str | None, width: int | None, height: int | None) -> tuple[int | None, int | None]:
    """Width and height from --size, or from --width and --height, of which one alone keeps the proportions."""
    if size is None:
        return width, height
    if width is not None or height is not None:
        raise SettingsError(f"--size is {size!r} and --width or --height is given as well; give one or the other")
    return parse_size(size)


def parse_region(text: str) -> Region:
    """'10,20,300,200' as x, y, width and height, or the path of an image as a mask."""
    numbers = re.fullmatch(r"\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*", text)
    return Region.of([int(n) for n in numbers.groups()]) if numbers else Region.read(text)


def parse_range(text: str) -> range:
    """'64:128' as range(64, 128)."""
    found = re.fullmatch(r"\s*(\d+)\s*:\s*(\d+)\s*", text)
    if not found:
        raise SettingsError(
            f"--replicates is {text!r}; write it as FIRST:END, for example 64:128, of which 128 is the first that is "
            "not rendered"
        )
    return range(int(found.group(1)), int(found.group(2)))


def parse_camera(given: Sequence[str]) -> Camera | None:
    """'origin=0,1,5' 'fov=40', several parts in one or in several texts, as a camera."""
    parts: dict[str, Any] = {}
    for part in " ".join(given).split():
        name, is_given, value = part.partition("=")
        try:
            numbers = [float(one) for one in value.split(",")] if is_given else []
        except ValueError:
            numbers = []
        if not numbers or (len(numbers) != 1 if name == "fov" else len(numbers) != 3):
            raise SettingsError(
                f"--camera has {part!r}; write origin=X,Y,Z target=X,Y,Z up=X,Y,Z fov=DEGREES, any of them, without "
                "spaces around commas"
            )
        if name in parts:
            raise SettingsError(f"--camera gives {name} twice; give it once")
        parts[name] = numbers[0] if name == "fov" else numbers
    return Camera.of(parts)


def parse_sweep(given: Sequence[str]) -> list[dict[str, str]]:
    """'x=1,2,3' 'tint=1,0,0;0,1,0' as all combinations; values that have commas are parted by semicolons."""
    values: dict[str, list[str]] = {}
    for text in given:
        name, is_given, listed = text.partition("=")
        found = [one.strip() for one in listed.split(";" if ";" in listed else ",")]
        if not is_given or not name or not all(found):
            raise SettingsError(f"--sweep is {text!r}; write --sweep name=1,2,3, or name=1,0,0;0,1,0")
        if name in values:
            raise SettingsError(f"--sweep {name} is given twice; list its values once")
        values[name] = found
    return product(values)


def names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def limit_threads(threads: int | None) -> None:
    """Of the processor, that kernels may use. Comes before the first kernel."""
    if threads is not None:
        os.environ["FREDHOLM_THREADS"] = str(threads)


def check_is_exr(path: Path, option: str = "--output") -> None:
    """Refuses what no EXR can be named, before anything is rendered."""
    check_name(path, option, SettingsError)
    if path.suffix.lower() != ".exr":
        raise SettingsError(f"{option} is {path}; the name must end in .exr")
