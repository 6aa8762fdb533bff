#!/usr/bin/env python3
"""Contact loss and run-up of the golden pair (tests/vectors/dynamics.json) by SciPy's DOP853, to tight tolerance.

Writes tests/vectors/dynamics-nonlinear.json. Needs numpy and scipy. The equations are written down again here from the
vector file alone: 8 coordinates (motor, pinion, gear, load, x1, y1, x2, y2), delta = h . q, square-wave stiffness, mesh
damping 2 zeta sqrt(k m_e) shared by the pairs as the stiffness is. With contact loss every pair in contact carries only
while delta > 0 (drive) or delta < -clearance (coast); all pairs see the same delta here, so they change together.
"""
import json
import math
import pathlib

import numpy as np
from scipy.integrate import solve_ivp

ROOT = pathlib.Path(__file__).resolve().parent.parent / "vectors"
V = json.loads((ROOT / "dynamics.json").read_text())
Z1, Z2 = 19, 48
ALPHA = math.radians(20.0)
RB = [0.5 * V["module_m"] * z * math.cos(ALPHA) for z in (Z1, Z2)]
J = V["inertia_kg_m2"]
M1, M2 = V["mass_kg"]
MASS = np.array([J["motor"], J["pinion"], J["gear"], J["load"], M1, M1, M2, M2])
H = np.array([0, RB[0], -RB[1], 0, math.sin(ALPHA), math.cos(ALPHA), -math.sin(ALPHA), -math.cos(ALPHA)])
ME = 1.0 / (RB[0] ** 2 / J["pinion"] + RB[1] ** 2 / J["gear"])
K = [V["stiffness_square_wave_n_per_m"]["double"], V["stiffness_square_wave_n_per_m"]["single"]]
PART = V["contact_ratio"] - 1.0
TORQUE = V["torque_n_m"]
FORCE = np.zeros(8)
FORCE[0], FORCE[3] = TORQUE, -TORQUE * Z2 / Z1
K0, C0 = np.zeros((8, 8)), np.zeros((8, 8))
KC, CC = V["coupling_stiffness_n_m_per_rad"], V["coupling_damping_n_m_s_per_rad"]
for side, (i, j) in enumerate(((0, 1), (2, 3))):
    for matrix, value in ((K0, KC[side]), (C0, CC[side])):
        matrix[i, i] += value
        matrix[j, j] += value
        matrix[i, j] -= value
        matrix[j, i] -= value
for i in range(4, 8):
    K0[i, i] += V["bearing_stiffness_n_per_m"]
    C0[i, i] += V["bearing_damping_n_s_per_m"]


def static():
    k = K[0] * PART + K[1] * (1 - PART)
    q = np.linalg.lstsq(K0 + k * np.outer(H, H), FORCE, rcond=None)[0]
    rigid = np.array([1, 1, Z1 / Z2, Z1 / Z2, 0, 0, 0, 0])
    return q - rigid * (rigid @ q) / (rigid @ rigid)


def rhs(k, regime, clearance):
    c = 2 * 0.03 * math.sqrt(k * ME)

    def f(_, y):
        q, v = y[:8], y[8:]
        delta, rate = H @ q, H @ v
        force = 0.0
        if regime == 1:
            force = k * delta + c * rate
        elif regime == -1:
            force = k * (delta + clearance) + c * rate
        return np.concatenate([v, (FORCE - H * force - K0 @ q - C0 @ v) / MASS])

    return f


def zones(turns_to_time, turns):
    """Borders in time of zones of constant stiffness."""
    n, out = 0, []
    while n / Z1 < turns:
        out.append((turns_to_time(n / Z1), turns_to_time((n + PART) / Z1), 0))
        out.append((turns_to_time((n + PART) / Z1), turns_to_time((n + 1) / Z1), 1))
        n += 1
    return out


def integrate(y, segments, clearance=None):
    tolerance = dict(method="DOP853", rtol=1e-13, atol=np.r_[np.full(4, 1e-16), np.full(4, 1e-18), np.full(4, 1e-12), np.full(4, 1e-13)])
    regime, switches = 1, 0
    if clearance is not None:
        delta = H @ y[:8]
        regime = 1 if delta > 0 else (-1 if delta < -clearance else 0)
    for start, end, zone in segments:
        t = start
        while end - t > 1e-15:
            if clearance is None:
                s = solve_ivp(rhs(K[zone], 1, 0.0), (t, end), y, **tolerance)
                t, y = end, s.y[:, -1]
                continue

            def drive(_, y):
                return H @ y[:8]

            def coast(_, y):
                return H @ y[:8] + clearance

            events = {1: [drive], 0: [drive, coast], -1: [coast]}[regime]
            directions = {1: [-1], 0: [1, -1], -1: [1]}[regime]
            for event, direction in zip(events, directions):
                event.terminal, event.direction = True, direction
            s = solve_ivp(rhs(K[zone], regime, clearance), (t, end), y, events=events, max_step=2e-6, **tolerance)
            t, y = s.t[-1], s.y[:, -1]
            if s.status == 1:
                hit = 0 if len(s.t_events[0]) else 1
                regime = {(1, 0): 0, (0, 0): 1, (0, 1): -1, (-1, 0): 0}[(regime, hit)]
                switches += 1
    return y, switches


def main():
    result = {}
    start = np.concatenate([static(), np.zeros(8)])
    start[8] = -20.0
    clearance = 20e-6
    speed = 30.0
    y, switches = integrate(start.copy(), zones(lambda turns: turns / speed, 3 / Z1), clearance)
    result["contact_loss"] = {"speed_hz": speed, "clearance_m": clearance, "motor_velocity_rad_s": -20.0, "mesh_periods": 3,
                              "switches": switches, "deflection": y[:8].tolist(), "velocity": y[8:].tolist()}
    a, b, duration = 20.0, 40.0, 0.02
    slope = (b - a) / duration

    def time(turns):
        at_end = a * duration + 0.5 * slope * duration ** 2
        if turns <= at_end:
            return (-a + math.sqrt(a * a + 2 * slope * turns)) / slope
        return duration + (turns - at_end) / b

    start[8] = 0.0
    periods = 19
    y, _ = integrate(start.copy(), zones(time, periods / Z1))
    result["run_up"] = {"from_hz": a, "to_hz": b, "duration_s": duration, "end_s": time(periods / Z1), "mesh_periods": periods,
                        "deflection": y[:8].tolist(), "velocity": y[8:].tolist()}
    (ROOT / "dynamics-nonlinear.json").write_text(json.dumps(result, indent=1) + "\n")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
