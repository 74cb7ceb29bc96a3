#!/usr/bin/env python3
"""How long the service takes from exec to READY=1, and until parts may come: the simulated cell, once without its cache of drawn
parts and then with it, told by the service itself over sd_notify.

    tests/bench/service_start.py BUILD/bin/hordd deploy/hordd.toml [RUNS]"""
import os, re, socket, statistics, subprocess, sys, tempfile, time


def start(hordd, config, folder):
    """Seconds to READY=1 and to ContinuousExecution."""
    with tempfile.TemporaryDirectory() as here, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as told:
        told.bind(here + "/notify")
        told.settimeout(600)
        os.mkdir(here + "/state")
        begun = time.monotonic()
        service = subprocess.Popen([hordd, "--config", config], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, env=dict(
            os.environ, NOTIFY_SOCKET=here + "/notify", STATE_DIRECTORY=here + "/state", CACHE_DIRECTORY=folder + "/cache"))
        ready = running = None
        while ready is None or running is None:
            said = told.recv(4096).decode()
            if ready is None and "READY=1" in said: ready = time.monotonic() - begun
            if "ContinuousExecution" in said: running = time.monotonic() - begun
            if "STATUS=" in said and service.poll() is not None: sys.exit(f"hordd ended: {service.stderr.read().decode()}")
        service.terminate()
        service.communicate()
        return ready, running


hordd, config = sys.argv[1:3]
runs = int(sys.argv[3]) if len(sys.argv) > 3 else 10
with tempfile.TemporaryDirectory() as folder:
    os.mkdir(folder + "/cache")
    text = open(config).read()
    # Any free port: a service may be running here.
    head, modbus = text.split("\n[modbus]", 1)
    os.symlink(os.path.abspath(os.path.join(os.path.dirname(config), "recipes")), folder + "/recipes")
    open(folder + "/hordd.toml", "w").write(head + "\n[modbus]" + re.sub(r"\nport = \d+", "\nport = 0", modbus, count=1))
    cold = start(hordd, folder + "/hordd.toml", folder)
    warm = [start(hordd, folder + "/hordd.toml", folder) for _ in range(runs)]
print(f"\nStart of the service, simulated cell; load {os.getloadavg()[0]:.1f}\n\n| start | to READY=1, s | to ContinuousExecution, s |\n|---|---|---|")
print(f"| first: the simulated parts are drawn | {cold[0]:.2f} | {cold[1]:.2f} |")
for name, pick in (("later, median", statistics.median), ("later, longest", max)):
    print(f"| {name} of {runs} | {pick(w[0] for w in warm):.2f} | {pick(w[1] for w in warm):.2f} |")
