#!/usr/bin/env python3
"""Natural frequencies of a two-stage spur train (23/61, 19/77) beside those of ROSS 2.3.0 (NumPy 2.4.6), speed 0.

    python -m venv ross && ross/bin/pip install ross-rotordynamics "plotly<6"
    cargo build --release -p meshband-train-dynamics --examples
    ross/bin/python tests/compare/ross_train.py target/release/examples/natural_frequencies

Our 13 elastic frequencies beside ROSS's by value, with a nested MultiRotor and our mean mesh stiffness. Largest
relative difference: below 1e-13 with springs against twist for shafts; 4e-7 with massless shafts and gears of 1e-6 of
their inertia against tilting; 0.12 where gears tilt in full; 0.13 with the shafts' mass too. ROSS takes each driver's
line of action as of one turning counter-clockwise: without `opposite_flank` for stage 2 the first case differs by 0.11.
"""
import json, math, os, subprocess, sys, tomllib, warnings
from pathlib import Path

warnings.simplefilter("ignore")
import numpy as np
from scipy.linalg import eigh
from scipy.optimize import linear_sum_assignment

# A dependency of ROSS prints about missing libraries on import: kept out of the output.
page, nothing = os.dup(1), os.open(os.devnull, os.O_WRONLY)
os.dup2(nothing, 1)
import ross as rs

os.dup2(page, 1)

ROOT = Path(__file__).resolve().parents[2]
MACHINE = ROOT / "host/train_dynamics/tests/vectors/two_spur_stages.toml"
# ROSS wants lateral mass at drive and load, which turn only on our side; a bearing holds them there.
END_MASS_KG, END_N_PER_M = 1.0, 1e8
# Length between neighbours on a shaft that can bend; its diameter gives the declared stiffness against twist.
SHAFT_LENGTH_M = 0.1
# Words, what joins neighbours, inertia against tilting over that against turning, whether stage 2 is turned.
CASES = [
    ("springs against twist", "spring", 0.5, True),
    ("the same, stage 2 not turned", "spring", 0.5, False),
    ("massless shafts, gears that hardly tilt", "light", 5e-7, True),
    ("massless shafts, gears that tilt", "light", 0.5, True),
    ("steel shafts, gears that tilt", "heavy", 0.5, True),
]
# Largest relative difference that the first case may have.
SAME = 1e-9


def opposite_flank(angle, pressure):
    """Orientation that gives ROSS the line of action of a driver that turns clockwise.

    ROSS puts that line at 90 degrees less the pressure angle from the line of centres, where a driver turning
    counter-clockwise presses. The second shaft turns clockwise: its line lies on the other side.
    """
    return angle - math.pi + 2.0 * pressure


def link(shaft, twist):
    """What joins two neighbours on a shaft: a spring against twist only, or a shaft of steel that twists as much."""
    if shaft == "spring":
        spring = rs.CouplingElement(m_l=0.0, m_r=0.0, Ip_l=0.0, Ip_r=0.0, kr_z=twist)
        # A rotor of couplings alone fails without the bores of a shaft, which are for drawing.
        spring.i_d = spring.idl = spring.idr = 0.0
        return spring
    steel = rs.Material(name="shaft", rho={"light": 1e-3, "heavy": 7810.0}[shaft], E=211e9, G_s=81.2e9)
    diameter = (32.0 * twist * SHAFT_LENGTH_M / (math.pi * steel.G_s)) ** 0.25
    return rs.ShaftElement(L=SHAFT_LENGTH_M, idl=0.0, odl=diameter, material=steel)


def train(machine, ours, shaft, tilt, turned):
    """The train in ROSS: shafts of nodes drive 0, pinion 1; gear 2, pinion 3; gear 4, load 5."""
    shafts, meshes = machine["shaft"], machine["mesh"]
    couplings = [machine[end]["coupling_stiffness_n_m_per_rad"] for end in ("drive", "load")]

    def gear(n, index):
        mesh, side = meshes[index // 2], index % 2
        teeth = machine["stage"][index // 2]["teeth"][side]
        ip = ours["inertia_kg_m2"][index]
        return rs.GearElement(
            n=n, m=ours["mass_kg"][index], Id=tilt * ip, Ip=ip, n_teeth=teeth,
            pitch_diameter=1e-3 * mesh["module_mm"] * teeth, pr_angle=math.radians(mesh["pressure_angle_deg"]),
        )

    def end(n, index):
        ip = ours["end_inertia_kg_m2"][index]
        return rs.DiskElement(n=n, m=END_MASS_KG, Id=tilt * ip, Ip=ip)

    def bearing(n, number):
        k = shafts[number]["bearing_stiffness_n_per_m"]
        return rs.BearingElement(n=n, kxx=k[0], kyy=k[1], cxx=0.0, cyy=0.0)

    def held(n):
        return rs.BearingElement(n=n, kxx=END_N_PER_M, kyy=END_N_PER_M, cxx=0.0, cyy=0.0)

    twist = shafts[1]["torsional_stiffness_n_m_per_rad"]
    first = rs.Rotor([link(shaft, couplings[0])], [end(0, 0), gear(1, 0)], [held(0), bearing(1, 0)])
    second = rs.Rotor([link(shaft, twist)], [gear(0, 1), gear(1, 2)], [bearing(0, 1), bearing(1, 1)])
    third = rs.Rotor([link(shaft, couplings[1])], [gear(0, 3), end(1, 1)], [bearing(0, 2), held(1)])
    angles = [math.radians(mesh["centre_line_deg"]) for mesh in meshes]
    if turned:
        angles[1] = opposite_flank(angles[1], math.radians(meshes[1]["pressure_angle_deg"]))
    stiffness = ours["mesh_stiffness_n_per_m"]
    both = rs.MultiRotor(first, second, (1, 0), gear_mesh_stiffness=stiffness[0], orientation_angle=angles[0])
    # Node 3 of the first two shafts together is the pinion of stage 2.
    return rs.MultiRotor(both, third, (3, 0), gear_mesh_stiffness=stiffness[1], orientation_angle=angles[1])


def modes(rotor):
    """Undamped elastic modes at speed 0, Hz, from the matrices that ROSS assembles."""
    squares = eigh(rotor.K(0), rotor.M(0), eigvals_only=True)
    elastic = squares[squares > 1e-10 * squares[-1]]
    return np.sqrt(elastic) / (2.0 * math.pi)


def differences(mine, theirs):
    """Relative difference of each of our frequencies from its own partner, partners chosen for the least sum."""
    cost = np.abs(theirs[None, :] / mine[:, None] - 1.0)
    _, columns = linear_sum_assignment(cost)
    return theirs[columns] / mine - 1.0


def main():
    machine = tomllib.loads(MACHINE.read_text())
    ours = json.loads(subprocess.run([sys.argv[1], MACHINE], check=True, capture_output=True, text=True).stdout)
    mine = np.array(ours["frequencies_hz"][1:])
    print(f"ROSS {rs.__version__}, NumPy {np.__version__}, {MACHINE.name}: {len(mine)} elastic frequencies")
    for name, shaft, tilt, turned in CASES:
        rotor = train(machine, ours, shaft, tilt, turned)
        theirs = modes(rotor)
        found = differences(mine, theirs)
        # What ROSS itself gives at speed 0, without rigid modes.
        modal = np.unique(rotor.run_modal(0, num_modes=2 * rotor.ndof, sparse=False).wn) / (2.0 * math.pi)
        own = max(np.min(np.abs(theirs / value - 1.0)) for value in modal)
        print(
            f"{name}: largest difference {np.abs(found).max():.1e}, of the lowest {found[0]:+.1e}; ROSS has "
            f"{len(theirs)} elastic modes, its run_modal within {own:.0e} of its matrices"
        )
        for value, difference in zip(mine, found):
            print(f"    {value:10.3f} Hz {difference:+.1e}")
        if name == CASES[0][0] and np.abs(found).max() > SAME:
            sys.exit(f"{name}: the models are not the same")


if __name__ == "__main__":
    main()
