"""Print a line for every estimate; the endpoint to connect to is the first argument."""

import json
import sys

import zenoh

config = zenoh.Config()
config.insert_json5("connect/endpoints", json.dumps(sys.argv[1:2]))
with zenoh.open(config) as session, session.declare_subscriber("landslope/*/estimate") as estimates:
    for sample in estimates:
        estimate = json.loads(sample.payload.to_bytes())
        print(sample.key_expr, estimate["frame"], estimate["status"], estimate["inclination_deg"], flush=True)
