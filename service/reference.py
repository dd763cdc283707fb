"""The page at /docs: the API's description as plain HTML, without scripts and without other sites.

Enters: the OpenAPI document. Leaves: HTML.
"""

from __future__ import annotations

import json
from html import escape
from typing import Any

STYLE = """
:root { color-scheme: dark light; --page: #161616; --panel: #1f1f1f; --line: #3a3a3a; --text: #e6e6e6;
  --dim: #a8a8a8; --accent: #5aa9ff; }
@media (prefers-color-scheme: light) { :root { --page: #f4f4f4; --panel: #fff; --line: #ccc; --text: #1a1a1a;
  --dim: #5a5a5a; --accent: #0b5cad; } }
body { font: 15px/1.5 system-ui, sans-serif; background: var(--page); color: var(--text); max-width: 60rem;
  margin: 2rem auto; padding: 0 1rem; }
a { color: var(--accent); }
code, pre { font: 13px/1.45 ui-monospace, monospace; }
pre { background: var(--panel); border: 1px solid var(--line); padding: .5rem .75rem; overflow-x: auto; }
details { border: 1px solid var(--line); background: var(--panel); margin: .5rem 0; padding: .4rem .75rem; }
summary { cursor: pointer; }
summary b { display: inline-block; min-width: 4.5em; font: 600 13px ui-monospace, monospace; color: var(--accent); }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; vertical-align: top; padding: .2rem .75rem .2rem 0; border-top: 1px solid var(--line); }
.dim { color: var(--dim); }
label, input, button { font: inherit; }
input { width: 100%; box-sizing: border-box; padding: .4rem; margin: .4rem 0 .8rem; background: var(--panel);
  color: var(--text); border: 1px solid var(--line); }
button { padding: .4rem 1rem; }
"""

_METHODS = ("get", "post", "put", "patch", "delete")


def page(title: str, body: str, root: str = "") -> str:
    """A plain page of the service. root: relative address of the service's root, ending in /."""
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<link rel="icon" href="{root}favicon.svg" type="image/svg+xml">'
        f'<link rel="stylesheet" href="{root}docs.css"></head><body>\n{body}\n</body></html>\n'
    )


def reference(document: dict[str, Any]) -> str:
    """The description of all operations and messages."""
    info = document["info"]
    parts = [
        f"<h1>{escape(info['title'])}: the API</h1>",
        f'<p>{escape(info.get("summary", ""))}. Version {escape(info["version"])}; <a href="api/openapi.json">'
        "openapi.json</a> is the same for machines. Every error is a problem body (RFC 9457).</p>",
    ]
    by_tag: dict[str, list[str]] = {}
    for path, methods in document["paths"].items():
        for method in _METHODS:
            if method in methods:
                operation = methods[method]
                by_tag.setdefault((operation.get("tags") or ["other"])[0], []).append(
                    _operation(path, method, operation)
                )
    for tag, operations in by_tag.items():
        parts.append(f"<h2>{escape(tag.capitalize())}</h2>")
        parts.extend(operations)
    parts.append("<h2>Messages</h2>")
    for name, schema in sorted(document.get("components", {}).get("schemas", {}).items()):
        parts.append(f'<details id="{escape(name)}"><summary><code>{escape(name)}</code> {_text(schema)}</summary>')
        parts.append(_fields(schema) + "</details>")
    return page(f"{info['title']} API", "\n".join(parts))


def _operation(path: str, method: str, operation: dict[str, Any]) -> str:
    rows = [
        f"<tr><td><code>{escape(one['name'])}</code> <span class=dim>{escape(one['in'])}</span></td>"
        f"<td>{_type(one.get('schema', {}))}</td><td>{_text(one)}</td></tr>"
        for one in operation.get("parameters", ())
    ]
    table = f"<table><tr><th>parameter<th>type<th>meaning</tr>{''.join(rows)}</table>" if rows else ""
    body = "".join(
        f"<p>Body: <code>{escape(kind)}</code> {_type(content.get('schema', {}))}</p>"
        for kind, content in operation.get("requestBody", {}).get("content", {}).items()
    )
    answers = "".join(
        f"<tr><td>{escape(status)}</td><td>{_answer(answer)}</td><td>{_text(answer)}</td></tr>"
        for status, answer in operation["responses"].items()
    )
    head = f"<b>{method.upper()}</b> <code>{escape(path)}</code> {escape(operation.get('description', ''))}"
    return (
        f"<details><summary>{head}</summary>{table}{body}"
        f"<table><tr><th>answer<th>type<th>meaning</tr>{answers}</table></details>"
    )


def _answer(answer: dict[str, Any]) -> str:
    return "<br>".join(
        f"<code>{escape(kind)}</code> {_type(content.get('schema', {}))}"
        for kind, content in answer.get("content", {}).items()
    )


def _fields(schema: dict[str, Any]) -> str:
    required = set(schema.get("required", ()))
    rows = [
        f"<tr><td><code>{escape(name)}</code>{'' if name in required else ' <span class=dim>optional</span>'}</td>"
        f"<td>{_type(one)}</td><td>{_text(one)}</td></tr>"
        for name, one in schema.get("properties", {}).items()
    ]
    if rows:
        return f"<table><tr><th>field<th>type<th>meaning</tr>{''.join(rows)}</table>"
    return f"<pre>{escape(json.dumps(schema, indent=1))}</pre>"


def _type(schema: dict[str, Any]) -> str:
    """A schema in a few words, with links to the messages it names."""
    if "$ref" in schema:
        name = escape(schema["$ref"].rpartition("/")[2])
        return f'<a href="#{name}">{name}</a>'
    for joiner in ("anyOf", "oneOf", "allOf"):
        if joiner in schema:
            return " | ".join(_type(one) for one in schema[joiner])
    if "enum" in schema:
        return escape(" | ".join(json.dumps(one) for one in schema["enum"]))
    if "const" in schema:
        return escape(json.dumps(schema["const"]))
    if schema.get("type") == "array":
        return f"list of {_type(schema.get('items', {}))}"
    limits = [
        f"{sign} {schema[key]}"
        for key, sign in (("minimum", "≥"), ("maximum", "≤"), ("minLength", "length ≥"), ("maxLength", "length ≤"))
        if key in schema
    ]
    return escape(" ".join([str(schema.get("format") or schema.get("type", "any")), *limits]))


def _text(schema: dict[str, Any]) -> str:
    return escape(schema.get("description", "")).replace("\n", "<br>")
