"""The contract as TypeScript: `python -m pomona.stages.report.typescript` prints `viewer/src/contract.ts`."""

from __future__ import annotations

import dataclasses
import inspect
import types
from collections.abc import Mapping, Sequence
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from pomona.stages.report.contract import (
    F32,
    U8,
    U16,
    U32,
    CorrectionAnswer,
    CorrectionKind,
    CorrectionRequest,
    CorrectionState,
    DetectionColumns,
    EarlierFruits,
    FruitColumns,
    PackedCloud,
    PhotoColumns,
    PhotoMark,
    PointPiece,
    Rates,
    SeenFruit,
    Sightings,
    SightLines,
    Source,
    SurveyData,
    TreePlaces,
    TruthData,
    ViewHints,
    WatchHint,
    WatchPhase,
    WatchState,
    camel_case,
)  # fmt: skip

_INTERFACES = (
    PackedCloud, PointPiece, FruitColumns, PhotoColumns, Sightings, DetectionColumns, SeenFruit, TreePlaces, Rates,
    TruthData, EarlierFruits, ViewHints, CorrectionState, PhotoMark, CorrectionRequest, CorrectionAnswer, SightLines,
    WatchHint, WatchState, SurveyData,
)  # fmt: skip
_COLUMNS = {U8: "Uint8Array", U16: "Uint16Array", U32: "Uint32Array", F32: "Float32Array"}
_CHOICES = {"Source": Source, "CorrectionKind": CorrectionKind, "WatchPhase": WatchPhase}
_PLAIN = {str: "string", int: "number", float: "number", bool: "boolean", type(None): "null"}


def typescript() -> str:
    """Return the contract as a TypeScript module."""
    about = "What Python tells the viewer. Written by `python -m pomona.stages.report.typescript`; do not edit."
    columns = [f"export type {column.__name__} = {array};" for column, array in _COLUMNS.items()]
    return module(about, _INTERFACES, _CHOICES, before=columns)


def module(about: str, interfaces: Sequence[type], choices: Mapping[str, Any], *, before: Sequence[str] = ()) -> str:
    """Return dataclasses as interfaces of a TypeScript module, `choices` of texts as types, after lines `before`."""
    lines = [f"/** {about} */", "", *before]
    for name, texts in choices.items():
        lines += [f"export type {name} = {' | '.join(repr(s) for s in get_args(texts))};".replace("'", '"')]
    lines.append("")
    for interface in interfaces:
        hints = get_type_hints(interface)
        doc = inspect.getdoc(interface) or ""
        lines += ["/**", *(f" * {line}".rstrip() for line in doc.splitlines()), " */"]
        lines += [f"export interface {interface.__name__} {{"]
        fields = dataclasses.fields(interface)
        lines += [f"  {camel_case(f.name)}: {_typescript(hints[f.name], choices)};" for f in fields]
        lines += ["}", ""]
    return "\n".join(lines)


def _typescript(hint: Any, choices: Mapping[str, Any]) -> str:
    for name, texts in choices.items():
        if hint == texts:
            return name
    if get_origin(hint) is Literal:
        return " | ".join(f'"{text}"' for text in get_args(hint))
    if hint in _PLAIN:
        return _PLAIN[hint]
    if get_origin(hint) is list:
        return f"{_typescript(get_args(hint)[0], choices)}[]"
    if get_origin(hint) is tuple:
        return f"[{', '.join(_typescript(part, choices) for part in get_args(hint))}]"
    if get_origin(hint) in (Union, types.UnionType):
        return " | ".join(_typescript(part, choices) for part in get_args(hint))
    return str(hint.__name__)


if __name__ == "__main__":
    print(typescript(), end="")
