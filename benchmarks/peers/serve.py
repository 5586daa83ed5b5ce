"""What all peers share: the job comes as the first line, then each line asks for one run and gets its seconds."""

import json
import sys
import time


def serve(prepare):
    """Prepare the job `prepare(job) -> run() -> (soc, voltage)`, warm it up, and run it as often as asked."""
    run = prepare(json.loads(sys.stdin.readline()))
    soc, volts = run()
    print(json.dumps({"soc": list(map(float, soc)), "voltage_V": list(map(float, volts))}), flush=True)
    for _ in sys.stdin:
        began = time.perf_counter()
        run()
        print(json.dumps(time.perf_counter() - began), flush=True)
