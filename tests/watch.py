# SPDX-License-Identifier: MIT
"""Run tests, and stop them if none has ended for some time; no name of a failed test is lost.

    /usr/bin/python3 tests/watch.py SECONDS COMMAND...

A limit of the whole run would be too short on a slow machine, or long for one that hangs. If the
run is stopped, here or by a signal, or ends early, as by a crash, a line for each test that failed
and for each that was running is printed, in the form of pytest's summary. The exit code is that of
the command, and 124 if it was stopped here. The command ends with arguments of pytest: one with the
folder of the records is added.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

STOPPED = 124  # exit code, as that of timeout
# Time from SIGTERM to SIGKILL [s]: mpirun ends all ranks.
GRACE = 30.0
PAUSE = 0.2  # between two looks at the records [s]


def records(folder):
    """Lines of all processes: rank or "serial", what happened, name of the test."""
    for path in sorted(folder.iterdir()):
        rank = path.name.partition("-")[0]
        for line in path.read_text().splitlines():
            what, _, name = line.partition("\t")
            yield rank, what, name


def summary(folder):
    """Lines on failed tests, and on those that were running, with their ranks."""
    failed, running = {}, {}
    for rank, what, name in records(folder):
        if what == "begun":
            running.setdefault(name, []).append(rank)
        elif what == "ended":
            running[name].remove(rank)
        else:
            failed[name] = what
    lines = [f"{what} {name}" for name, what in sorted(failed.items())]
    for name, ranks in sorted(running.items()):
        if ranks:
            where = "" if ranks == ["serial"] else f" on rank {', '.join(sorted(ranks))}"
            lines.append(f"ERROR {name} - running{where} when the run ended")
    return lines, any(running.values())


def end(process, number):
    """Send a signal to the processes of the run, and SIGKILL if they do not end."""
    for sent, patience in ((number, GRACE), (signal.SIGKILL, None)):
        try:
            os.killpg(process.pid, sent)
            process.wait(patience)
        except ProcessLookupError:
            return
        except subprocess.TimeoutExpired:
            continue


def watch(process, folder, limit):
    """Wait for the process; the reason for which it was stopped, or ""."""
    known, since = None, time.monotonic()
    while True:
        try:
            process.wait(PAUSE)
            return ""
        except subprocess.TimeoutExpired:
            sizes = {path: path.stat().st_size for path in folder.iterdir()}
        if sizes != known:
            known, since = sizes, time.monotonic()
        if time.monotonic() - since > limit:
            end(process, signal.SIGTERM)
            return f"no test has ended for {limit:g} s"


class Interrupted(BaseException):
    """A signal to this process; the argument is its number."""


def interrupt(number, _):
    raise Interrupted(number)


def main(limit, *command):
    with tempfile.TemporaryDirectory(prefix="fenics_mortar-progress.") as made:
        folder = Path(made)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, interrupt)
        process = subprocess.Popen(
            [*command, f"--progress={made}"], stdin=subprocess.DEVNULL, process_group=0
        )
        try:
            why = watch(process, folder, float(limit))
            code = STOPPED if why else process.returncode
        except Interrupted as interrupted:
            (number,) = interrupted.args
            end(process, number)
            why, code = f"signal {number}", -number
        lines, left = summary(folder)
        if why or left:
            print(f"\n##### the run was stopped: {why}" if why else "\n##### the run ended early")
            print("\n".join(lines), flush=True)
        return code if code >= 0 else 128 - code


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
