"""Read very many damaged files by every reader, ask servers for anything, and write tables of what became of it.

`python -m fuzz --files 10000` in `tests/`; `--reader NAME` for some alone, `--case N` to see one case fail; `--requests
10000` for the servers, which come last where all readers are wanted.
"""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from datetime import UTC, datetime
from pathlib import Path

from fuzz.campaign import Tally, damaged, run, scratch, write_examples
from fuzz.kept import keep
from fuzz.readers import READERS
from fuzz.requests import RequestTally
from fuzz.servers import targets


def main() -> int:
    """Run what the command line asks for; return 1 where a file was neither read nor refused."""
    parser = argparse.ArgumentParser(prog="python -m fuzz", description=__doc__)
    parser.add_argument("--files", type=int, default=10_000, help="damaged files for each reader")
    parser.add_argument("--reader", action="append", help="a reader, or how the names of several begin")
    parser.add_argument("--requests", type=int, help="requests to each server; as many as files where nothing is said")
    parser.add_argument("--case", type=int, help="show what this case of a reader does")
    parser.add_argument("--keep", type=Path, help="a folder for one file of each kind of finding, as `tests/fuzz/kept`")
    parser.add_argument("--out", type=Path, default=Path("fuzz.md"), help="where the table goes")
    options = parser.parse_args()
    wanted = [r for r in READERS if not options.reader or any(r.name.startswith(name) for name in options.reader)]
    if options.case is not None:
        return _show(wanted[0].name, options.case)
    tallies = []
    for reader in wanted:
        tally = run(reader, range(options.files))
        tallies.append(tally)
        print(_row(tally), flush=True)
        for kind in sorted({finding.kind for finding in tally.findings}):
            same = [finding for finding in tally.findings if finding.kind == kind]
            print(f"  {len(same)} x case {same[0].case}: {same[0].what} at {same[0].where}", flush=True)
            if options.keep is not None:
                keep(reader, same[0], options.keep)
        options.out.write_text(_table(tallies), encoding="utf-8")
    asked = []
    if options.requests or not options.reader:
        with scratch() as folder, targets(folder) as servers:
            for server in servers:
                asked.append(server.try_requests(range(options.requests or options.files)))
                print("\n  ".join([_request_row(asked[-1]), *asked[-1].findings[:20]]), flush=True)
        with options.out.open("a" if tallies else "w", encoding="utf-8") as file:
            file.write("\n" + _request_table(asked))
    return 1 if any(tally.findings for tally in (*tallies, *asked)) else 0


def _show(name: str, case: int) -> int:
    """Read one damaged file here, and let its error through."""
    reader = next(reader for reader in READERS if reader.name == name)
    with scratch() as place:
        examples = write_examples(reader, place)
        one = damaged(reader, examples, case)
        folder = dict(examples)[one.example]
        (folder / one.file).write_bytes(one.content)
        print(f"{one.file}: {len(one.content)} bytes\n{one.content[:2000]!r}")
        try:
            print(str(reader.read(one.example.path(folder)))[:500])
        except Exception:
            traceback.print_exc()
    return 0


def _row(tally: Tally) -> str:
    worst = f"{tally.slowest_s:.2f} | {tally.peak_mb:.0f}"
    counts = f"{tally.files} | {tally.refused} | {tally.read} | {len(tally.findings)}"
    return f"| {tally.name} | {counts} | {worst} | {tally.wall_s:.0f} |"


def _table(tallies: list[Tally]) -> str:
    head = ["reader", "files", "refused", "read", "findings", "slowest file, s", "peak memory, MB", "all, s"]
    sums = [sum(t.files for t in tallies), sum(t.refused for t in tallies), sum(t.read for t in tallies)]
    sums += [sum(len(t.findings) for t in tallies)]
    worst = f"{max(t.slowest_s for t in tallies):.2f} | {max(t.peak_mb for t in tallies):.0f}"
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head), *map(_row, tallies)]
    lines.append(
        f"| **{len(tallies)} readers** | {' | '.join(map(str, sums))} | {worst} "
        f"| {sum(t.wall_s for t in tallies):.0f} |"
    )
    day = datetime.now(UTC).date().isoformat()
    return f"{day}, Python {sys.version.split()[0]}, {os.cpu_count()} cores\n\n" + "\n".join(lines) + "\n"


def _request_row(tally: RequestTally) -> str:
    done = sum(count for status, count in tally.statuses.items() if status < 400)
    counts = f"{tally.requests} | {done} | {tally.statuses.total() - done} | {len(tally.findings)}"
    return f"| {tally.name} | {counts} | {tally.slowest_s:.2f} | {tally.most_read} | {tally.wall_s:.0f} |"


def _request_table(tallies: list[RequestTally]) -> str:
    head = [
        "server",
        "requests",
        "answered",
        "refused",
        "findings",
        "slowest, s",
        "read of a body, bytes",
        "all, s",
    ]
    return "\n".join(["| " + " | ".join(head) + " |", "|" + "---|" * len(head), *map(_request_row, tallies)]) + "\n"


if __name__ == "__main__":
    sys.exit(main())
