"""Facts about who imports whom: arrows go one way, and never round in a circle. Imports in functions count as well."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("renderer", "service")
MAY_KNOW = {"renderer": {"renderer"}, "service": {"renderer", "service"}}


def module_of(path: Path, root: Path) -> str:
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def sources(root: Path) -> dict[str, Path]:
    return {module_of(p, root): p for package in PACKAGES for p in sorted((root / package).rglob("*.py"))}


def is_for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def statements(node: ast.AST, with_types: bool) -> Iterator[ast.Import | ast.ImportFrom]:
    """All imports, wherever they stand; those for types alone only where they are wanted."""
    if isinstance(node, ast.Import | ast.ImportFrom):
        yield node
    for child in ast.iter_child_nodes(node):
        if with_types or not is_for_types(child):
            yield from statements(child, with_types)
        elif isinstance(child, ast.If):
            for other in child.orelse:
                yield from statements(other, with_types)


def imported(path: Path, module: str, known: frozenset[str], with_types: bool) -> set[str]:
    """The modules of `known` that a file imports."""
    found = set()
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    for node in statements(ast.parse(path.read_text(encoding="utf-8")), with_types):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            base = ".".join([*package.split(".")[: len(package.split(".")) - node.level + 1]]) if node.level else ""
            origin = ".".join(filter(None, (base, node.module)))
            # `from a import b` is an import of a.b where that is a module, else of a.
            names = [f"{origin}.{alias.name}" if f"{origin}.{alias.name}" in known else origin for alias in node.names]
        found |= {name for name in names if name in known}
    return found - {module}


@cache
def arrows(root: Path, with_types: bool = False) -> dict[str, set[str]]:
    files = sources(root)
    return {module: imported(path, module, frozenset(files), with_types) for module, path in files.items()}


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules of which each is reached from each other (Tarjan 1972)."""
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(module: str) -> None:
        order[module] = low[module] = len(order)
        stack.append(module)
        for other in sorted(graph[module]):
            if other not in order:
                visit(other)
            if other in stack:
                low[module] = min(low[module], low[other])
        if low[module] == order[module]:
            group = stack[stack.index(module) :]
            del stack[stack.index(module) :]
            if len(group) > 1:
                found.append(sorted(group))

    for module in graph:
        if module not in order:
            visit(module)
    return found


def test_no_modules_import_each_other_in_a_circle() -> None:
    assert circles(arrows(ROOT)) == []


@pytest.mark.parametrize("package", PACKAGES)
def test_arrows_between_packages_go_one_way(package: str) -> None:
    graph = arrows(ROOT, with_types=True)
    odd = [
        f"{module} → {other}"
        for module, others in graph.items()
        for other in others
        if module.split(".")[0] == package and other.split(".")[0] not in MAY_KNOW[package]
    ]
    assert odd == []
    assert any(module.startswith(package) for module in graph)


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("import renderer.b", "from renderer.a import x"),
        ("def f():\n    from renderer import b", "def g():\n    if 1:\n        from .a import x"),
        ("try:\n    from renderer.b import y\nexcept ImportError:\n    pass", "import renderer.a as z"),
    ],
)
def test_a_circle_is_found_wherever_its_imports_stand(tmp_path: Path, a: str, b: str) -> None:
    (tmp_path / "renderer").mkdir()
    for name, text in (("__init__", ""), ("a", a), ("b", b), ("c", "import renderer.a, service.d")):
        (tmp_path / "renderer" / f"{name}.py").write_text(text)
    (tmp_path / "service").mkdir()
    (tmp_path / "service" / "d.py").write_text("")
    assert circles(arrows(tmp_path)) == [["renderer.a", "renderer.b"]]
    assert "service.d" in arrows(tmp_path)["renderer.c"]


def test_an_import_for_types_alone_makes_no_circle(tmp_path: Path) -> None:
    (tmp_path / "renderer").mkdir()
    (tmp_path / "renderer" / "a.py").write_text("from renderer.b import x")
    (tmp_path / "renderer" / "b.py").write_text("if TYPE_CHECKING:\n    from renderer.a import y")
    assert circles(arrows(tmp_path)) == []
    assert circles(arrows(tmp_path, with_types=True)) == [["renderer.a", "renderer.b"]]
