"""Whether a run over the link ended in the band of the same run in one process. Usage: band.py KIND SUMMARY.json"""

import json
import sys

# In one process, the walking run of `run` with --robot op3 and seeds 1 to 6 ended at 0.053, 0.056, 0.057, 0.062, 0.029,
# 0.058 m/s; seed 2 is the one that is walked over the link. The nominal gait steps in place (0.005 m/s).

kind, path = sys.argv[1:]
run = json.load(open(path))
nominal, final = run["nominal"], run["final"]
falls = sum(i["falls"] for i in run["iterations"]) + final["falls"]
if kind == "stepping":
    shown = {"nominal_deg": nominal["mean_psi_roll_deg"], "final_deg": final["mean_psi_roll_deg"]}
    good = abs(shown["final_deg"]) <= 0.5 and shown["nominal_deg"] > 4.0
else:
    shown = {"nominal_m_s": nominal["speed_m_s"], "final_m_s": final["speed_m_s"]}
    good = 0.04 <= shown["final_m_s"] <= 0.08 and abs(shown["nominal_m_s"]) < 0.02
print(json.dumps({**shown, "falls": falls}))
sys.exit(0 if good and falls == 0 else 1)
