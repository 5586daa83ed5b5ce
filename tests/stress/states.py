"""`python -m tests.stress.states --examples 500 --steps 40`: what a person may do in any order, at length.

The fast tests take the same machines through a few short orders: a sweep's folder, an investigation, and a session of
the workbench. Each command of theirs ends as it should, or with one sentence.
"""

from __future__ import annotations

import argparse
import sys
import time

from hypothesis import HealthCheck, Verbosity, seed, settings
from hypothesis.stateful import RuleBasedStateMachine, run_state_machine_as_test

from tests.app.browser.test_session_states import Session
from tests.diagnosis.test_investigation_states import ByHand
from tests.sweeps.test_store_states import Sweep

MACHINES: dict[str, type[RuleBasedStateMachine]] = {"sweep": Sweep, "investigation": ByHand, "session": Session}


def main() -> int:
    """Run each machine; return 1 if one did what it should not, with the steps that led there."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--examples", type=int, default=500, help="orders of steps")
    parser.add_argument("--steps", type=int, default=40, help="of each order, at most")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--machine", action="append", choices=list(MACHINES))
    given = parser.parse_args()
    failed = 0
    for name in given.machine or MACHINES:
        began, machine = time.perf_counter(), MACHINES[name]
        how = settings(
            max_examples=given.examples,
            stateful_step_count=given.steps,
            deadline=None,
            database=None,
            suppress_health_check=list(HealthCheck),
            verbosity=Verbosity.normal,
        )
        try:
            run_state_machine_as_test(seed(given.seed)(machine), settings=how)
        except Exception as error:
            failed += 1
            print(f"{name}: {type(error).__name__}: {error}", *getattr(error, "__notes__", ()), sep="\n", flush=True)
        print(f"{name}: {given.examples} orders in {time.perf_counter() - began:.0f} s", flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
