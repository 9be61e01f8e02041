#!/usr/bin/env python3
"""Times whole runs against reading alone, and threads against processes, as ratios within one run.

Generates its recordings, then takes the commands in turn, so that a slow moment of the machine falls on all of them,
and prints medians, fsync apart, and peak memory. Needs nothing but Rust and Python.

    scripts/measure_runs.py                     # 1,000 MB, medians of 5
    scripts/measure_runs.py --megabytes 2000 --rounds 7 --json results.json
"""

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release"
CDR_FLAGS = ["--action", "/command:data", "--state", "/state:data", "--episodes", "gap:5"]


class Measured:
    """What the runs of one command took."""

    def __init__(self) -> None:
        self.seconds: list[float] = []
        self.sync: list[float] = []
        self.peak: int = 0

    def median(self) -> float:
        """Wall seconds without fsync."""
        return statistics.median(s - f for s, f in zip(self.seconds, self.sync, strict=True))


def finish(process: subprocess.Popen[bytes]) -> tuple[bytes, int]:
    """Waits for a process; its output and its peak memory in bytes."""
    assert process.stdout is not None
    output = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        sys.exit(f"{process.args} ended with {process.returncode}")
    return output, usage.ru_maxrss * 1024


def run(measured: Measured, *commands: list[str]) -> None:
    """Runs commands at the same time, each to its end."""
    started = time.perf_counter()
    processes = [subprocess.Popen(command, stdout=subprocess.PIPE) for command in commands]
    ended = [finish(process) for process in processes]
    measured.seconds.append(time.perf_counter() - started)
    sync = [json.loads(output).get("sync_seconds", 0.0) for output, _ in ended if output.startswith(b"{")]
    measured.sync.append(max(sync, default=0.0))
    measured.peak = max(measured.peak, *(peak for _, peak in ended))


def extract(recordings: Path, output: Path, threads: int, steps: str, *flags: str) -> list[str]:
    """A command line that writes into a directory that is empty."""
    shutil.rmtree(output, ignore_errors=True)
    options = ["--threads", str(threads), "--steps", steps, "--summary", "json", "--quiet"]
    return [str(TARGET / "coact"), "extract", str(recordings), "-o", str(output), *options, *flags]


def one_recording(folder: Path, kind: str, rounds: int) -> dict[str, Measured]:
    """A large recording: reading alone, one thread, two threads, two processes."""
    flags = CDR_FLAGS if kind == "cdr" else []
    path, out, other = folder / f"{kind}.mcap", folder / "out", folder / "other"
    results: dict[str, Measured] = {}
    for nth in range(rounds):
        run(results.setdefault("reading alone", Measured()), [str(TARGET / "examples/read_alone"), str(path)])
        for steps in ["none", "full"]:
            for threads in [1, 2]:
                name = f"--steps {steps} --threads {threads}"
                run(results.setdefault(name, Measured()), extract(path, out, threads, steps, *flags))
            shutil.rmtree(out, ignore_errors=True)
            commands = [extract(path, where, 1, steps, *flags) for where in (out, other)]
            run(results.setdefault(f"--steps {steps}, two processes", Measured()), *commands)
        print(f"{kind}: round {nth + 1} of {rounds}", file=sys.stderr)
    return results


def many_recordings(folder: Path, name: str, rounds: int) -> dict[str, Measured]:
    """A folder of recordings, each half of it again for the two processes."""
    path, out, other = folder / name, folder / "out", folder / "other"
    results: dict[str, Measured] = {}
    for nth in range(rounds):
        for steps in ["none", "full"]:
            for threads in [1, 2]:
                label = f"--steps {steps} --threads {threads}"
                run(results.setdefault(label, Measured()), extract(path, out, threads, steps))
            shutil.rmtree(out, ignore_errors=True)
            commands = [extract(path, where, 1, steps) for where in (out, other)]
            run(results.setdefault(f"--steps {steps}, two processes", Measured()), *commands)
        print(f"{name}: round {nth + 1} of {rounds}", file=sys.stderr)
    return results


def report(title: str, results: dict[str, Measured]) -> dict[str, Any]:
    """Prints a table; the same as data."""
    alone = results.get("reading alone")
    print(f"\n{title}\n\n| command | seconds | of reading alone | fsync, s | peak, MB |\n|---|---|---|---|---|")
    data: dict[str, Any] = {}
    for name, measured in results.items():
        seconds, sync = measured.median(), statistics.median(measured.sync)
        ratio = f"{seconds / alone.median():.2f}" if alone else ""
        print(f"| {name} | {seconds:.2f} | {ratio} | {sync:.2f} | {measured.peak / 1e6:.0f} |")
        data[name] = {"seconds": measured.seconds, "sync_seconds": measured.sync, "peak_bytes": measured.peak}
    for steps in ["none", "full"]:
        two = results[f"--steps {steps} --threads 2"].median()
        apart = results[f"--steps {steps}, two processes"].median()
        # Two processes do the work twice.
        print(f"\n--steps {steps}: two threads do {apart / 2 / two:.2f} of what two processes reach together")
        data[f"threads to processes, {steps}"] = apart / 2 / two
    return data


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--megabytes", type=int, default=1000, help="of messages in each large recording")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--folder", type=Path, help="for recordings and tables; default: a temporary one")
    parser.add_argument("--json", type=Path, help="write all times there")
    arguments = parser.parse_args()
    for build in (["--bin", "coact"], ["--examples"]):
        subprocess.run(["cargo", "build", "--release", "--locked", "--quiet", *build], cwd=ROOT, check=True)
    with tempfile.TemporaryDirectory(dir=arguments.folder) as name:
        folder = Path(name)
        generate = [str(TARGET / "examples/generate_recording")]
        for kind in ("json", "cdr"):
            subprocess.run([*generate, kind, str(arguments.megabytes), str(folder / f"{kind}.mcap")], check=True)
        (folder / "medium").mkdir()
        subprocess.run([*generate, "json", str(max(1, arguments.megabytes // 20)), str(folder / "medium/00.mcap")], check=True)
        for nth in range(1, 20):
            os.link(folder / "medium/00.mcap", folder / f"medium/{nth:02}.mcap")
        subprocess.run([*generate, "many", "5000", str(folder / "many")], check=True)
        data = {}
        for kind in ("json", "cdr"):
            data[kind] = report(f"One recording, {kind}, {arguments.megabytes} MB", one_recording(folder, kind, arguments.rounds))
        data["medium"] = report(f"20 recordings, json, {arguments.megabytes} MB in all", many_recordings(folder, "medium", arguments.rounds))
        many = many_recordings(folder, "many", arguments.rounds)
        data["many"] = report("5,000 recordings of 200 steps and 4 columns", many)
        rate = 5000 / statistics.median(many["--steps none --threads 1"].seconds)
        print(f"\n{rate:,.0f} recordings a second on one thread, fsync included")
    if arguments.json:
        arguments.json.write_text(json.dumps(data, indent=2))


if __name__ == "__main__":
    main()
