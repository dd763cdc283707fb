"""The API's messages as TypeScript interfaces, for the page.

python -m service.typescript            writes web/src/api/messages.ts
python -m service.typescript --check    says whether it is what the service speaks; exit code 1 if not
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from service.app import create_app
from service.settings import ServiceSettings

TARGET = Path(__file__).parents[1] / "web" / "src" / "api" / "messages.ts"
_HEAD = "/** Written by `python -m service.typescript` from the service's OpenAPI document; do not edit. */\n"
_SCALARS = {"string": "string", "integer": "number", "number": "number", "boolean": "boolean", "null": "null"}


def messages() -> str:
    """The whole module."""
    document = create_app(ServiceSettings()).openapi()
    schemas: dict[str, Any] = document["components"]["schemas"]
    parts = [_declaration(name, schema) for name, schema in sorted(schemas.items()) if not name.startswith("Body_")]
    return _HEAD + "\n" + "\n".join(parts)


def _declaration(name: str, schema: dict[str, Any]) -> str:
    head = _comment(schema.get("description"), "")
    if "properties" not in schema:
        return f"{head}export type {name} = {_type(schema)};\n"
    required = set(schema.get("required", ()))
    lines = [
        f"{_comment(field.get('description'), '  ')}  {key}{'' if key in required else '?'}: {_type(field)};\n"
        for key, field in schema["properties"].items()
    ]
    return f"{head}export interface {name} {{\n{''.join(lines)}}}\n"


def _type(schema: dict[str, Any]) -> str:
    if "$ref" in schema:
        return schema["$ref"].rsplit("/", 1)[-1]
    if "const" in schema:
        return json.dumps(schema["const"])
    if "enum" in schema:
        return " | ".join(json.dumps(value) for value in schema["enum"])
    for union in ("anyOf", "oneOf"):
        if union in schema:
            return " | ".join(dict.fromkeys(_type(part) for part in schema[union]))
    if "allOf" in schema:
        return " & ".join(_type(part) for part in schema["allOf"])
    match schema.get("type"):
        case "array" if "prefixItems" in schema:
            return f"[{', '.join(_type(item) for item in schema['prefixItems'])}]"
        case "array":
            item = _type(schema.get("items", {}))
            return f"({item})[]" if "|" in item or "&" in item else f"{item}[]"
        case "object" | None if isinstance(schema.get("additionalProperties"), dict):
            return f"Record<string, {_type(schema['additionalProperties'])}>"
        case "object":
            return "Record<string, unknown>"
        case str(kind):
            return _SCALARS[kind]
        case _:
            return "unknown"


def _comment(text: str | None, indent: str) -> str:
    if not text:
        return ""
    lines = text.strip().replace("*/", "* /").splitlines()
    if len(lines) == 1:
        return f"{indent}/** {lines[0]} */\n"
    body = "".join(f"{indent} * {line.strip()}".rstrip() + "\n" for line in lines)
    return f"{indent}/**\n{body}{indent} */\n"


def main(arguments: list[str]) -> int:
    """Command line."""
    text = messages()
    if arguments == ["--check"]:
        if TARGET.is_file() and TARGET.read_text(encoding="utf-8") == text:
            return 0
        print(f"{TARGET.name} is not what the service speaks: python -m service.typescript writes it", file=sys.stderr)
        return 1
    TARGET.write_text(text, encoding="utf-8")
    print(f"wrote {TARGET}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
