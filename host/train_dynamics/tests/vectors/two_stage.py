"""Two spur stages by SciPy, written apart from the Rust code: the vector two_stage.csv.

python3 -m venv venv && venv/bin/pip install numpy scipy
venv/bin/python two_stage.py > two_stage.csv

Each gear has rotation (counter-clockwise), x and y; drive and load turn. A pair's stiffness is a parabola over its
path of contact. DOP853 from knot to knot, relative tolerance 1e-12.
"""

import numpy as np
from scipy.integrate import solve_ivp

SPEED = 25.0  # Hz of shaft 0
LOAD = 150.0  # N m
STAGES = [  # teeth, module, angle of the centre line, contact ratio, peak stiffness, damping time
    ((23, 61), 2.0e-3, 0.3, 1.62, 2.1e8, 4e-7),
    ((19, 77), 3.0e-3, 1.4, 1.58, 3.4e8, 3e-7),
]
MASS = [0.4, 2.6, 0.5, 9.0]
INERTIA = [1.5e-4, 5.0e-3, 2.0e-4, 5.5e-2]
BEARING = [(1.2e8, 1.0e8), (1.5e8, 1.3e8), (1.5e8, 1.3e8), (2.0e8, 1.8e8)]
BEARING_DAMPING = [(500.0, 450.0), (1500.0, 1400.0), (600.0, 550.0), (3500.0, 3300.0)]
DRIVE, LOAD_INERTIA = 4.0e-3, 3.0e-2
INPUT, SHAFT, OUTPUT = (3.0e4, 0.3), (2.0e5, 0.5), (9.0e4, 4.0)
ALPHA = np.radians(20.0)

# Coordinates: drive, load, then rotation, x, y of the four gears.
N = 14
speeds = [1.0, -23 / 61, -23 / 61, 23 / 61 * 19 / 77]
mass = np.array([DRIVE, LOAD_INERTIA] + [v for i in range(4) for v in (INERTIA[i], MASS[i], MASS[i])])
K, C = np.zeros((N, N)), np.zeros((N, N))


def spring(i, j, stiffness, damping):
    e = np.zeros(N)
    e[i] = 1.0
    if j is not None:
        e[j] = -1.0
    K[:] += stiffness * np.outer(e, e)
    C[:] += damping * np.outer(e, e)


for gear in range(4):
    for axis in range(2):
        spring(3 + 3 * gear + axis, None, BEARING[gear][axis], BEARING_DAMPING[gear][axis])
spring(0, 2, *INPUT)
spring(5, 8, *SHAFT)
spring(1, 11, *OUTPUT)

meshes = []
for stage, (teeth, module, angle, ratio, peak, damping) in enumerate(STAGES):
    a, b = 2 + 6 * stage, 5 + 6 * stage
    way = np.sign(speeds[2 * stage])
    out = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-np.sin(angle), np.cos(angle)])
    force = np.sin(ALPHA) * out + way * np.cos(ALPHA) * across
    d = np.zeros(N)
    for at, z, sign in ((a, teeth[0], 1.0), (b, teeth[1], -1.0)):
        radius = module * z / 2
        contact = sign * radius * out
        d[at] = sign * (contact[0] * force[1] - contact[1] * force[0])
        d[at + 1 : at + 3] = sign * force
    order = abs(speeds[2 * stage]) * teeth[0]
    meshes.append((d, order, ratio, peak, damping))


def pair(s, ratio, peak):
    u = 2 * s / ratio - 1
    return peak * (1 - 0.4 * u * u) if 0 <= s < ratio else 0.0


def total(position, ratio, peak):
    frac = position - np.floor(position)
    return sum(pair(frac + n, ratio, peak) for n in range(3))


force = np.zeros(N)
turns_out = 23 / 61 * 19 / 77
force[0], force[1] = LOAD * turns_out, -LOAD


def rates(t, y):
    q, v = y[:N], y[N:]
    f = force - K @ q - C @ v
    for d, order, ratio, peak, damping in meshes:
        k = total(order * SPEED * t, ratio, peak)
        f -= k * (d @ q + damping * (d @ v)) * d
    return np.concatenate([v, f / mass])


mean = K.copy()
for d, order, ratio, peak, damping in meshes:
    mean += peak * ratio * (1 - 0.4 / 3) * np.outer(d, d)
rigid = np.zeros(N)
rigid[0], rigid[1] = 1.0, turns_out
for gear in range(4):
    rigid[2 + 3 * gear] = speeds[gear]
scale = np.abs(mean).max()
q = np.linalg.lstsq(np.vstack([mean / scale, rigid]), np.append(force / scale, 0.0), rcond=None)[0]

RATE, COUNT = 20e3, 200
knots = {0.0, COUNT / RATE}
for _, order, ratio, _, _ in meshes:
    for n in range(200):
        knots |= {n / order / SPEED, (n + ratio) / order / SPEED}
knots = sorted(k for k in knots if k <= COUNT / RATE)
knots = [k for i, k in enumerate(knots) if i == 0 or k - knots[i - 1] > 1e-12]
y, rows = np.concatenate([q, np.zeros(N)]), []
times = np.arange(COUNT) / RATE
for start, end in zip(knots, knots[1:]):
    # The middle of the piece decides which side of its knots a mesh is on.
    inside = times[(times >= start) & (times < end)]
    clip = lambda t, a=start, b=end: min(max(t, a + 1e-13), b - 1e-13)
    f = lambda t, y: rates(clip(t), y)
    solution = solve_ivp(f, (start, end), y, method="DOP853", rtol=1e-12, atol=1e-16, dense_output=True)
    rows += [rates(clip(t), solution.sol(t))[N:] for t in inside]
    y = solution.y[:, -1]
print("# accelerations at 20 kHz: rotation, x, y of gears 0 to 3, m/s2 or rad/s2")
for row in rows:
    print(",".join(f"{x:.9e}" for x in row[2:]))
