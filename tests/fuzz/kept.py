"""Damaged files that once were neither read nor refused, kept as they were found."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path

from fuzz.campaign import Damaged, Finding, damaged, scratch, write_examples
from fuzz.readers import READERS, Reader

FOLDER = Path(__file__).with_name("kept")


def keep(reader: Reader, finding: Finding, folder: Path) -> None:
    """Write the file of a finding to `folder`, named after the reader and what happened."""
    with scratch() as place:
        one = damaged(reader, write_examples(reader, place), finding.case)
    content = {
        "reader": reader.name,
        "example": reader.examples.index(one.example),
        "file": one.file.as_posix(),
        "found": f"{finding.what} at {finding.where}",
        "content": base64.b64encode(one.content).decode("ascii"),
    }
    folder.mkdir(parents=True, exist_ok=True)
    name = re.sub(r"[^a-z0-9]+", "-", f"{reader.name} {finding.kind}".lower()).strip("-")
    (folder / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def read_kept(path: Path) -> tuple[Reader, Damaged]:
    """Return the reader and the damaged file that `keep` wrote."""
    content = json.loads(path.read_text(encoding="utf-8"))
    reader = next(reader for reader in READERS if reader.name == content["reader"])
    example = reader.examples[content["example"]]
    return reader, Damaged(example, Path(content["file"]), base64.b64decode(content["content"]))
