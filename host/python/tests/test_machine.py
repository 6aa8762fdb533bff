"""Machines: declaration, stiffness, natural frequencies, law."""

import numpy as np
import pytest
from scipy.integrate import quad

import meshband


def test_ref_declaration_is_that_of_the_file(machine, root):
    assert machine.teeth == (17, 38)
    declared = machine.to_dict()
    assert declared["pair"]["module_m"] == 0.003
    text = (root / "machines" / "17-38.toml").read_text()
    assert meshband.Machine.from_toml(text).hash == machine.hash


def test_theory_mesh_stiffness_is_the_sum_of_the_pairs(machine):
    places = np.linspace(0.0, 1.0, 41, endpoint=False)
    report = machine.stiffness()
    pairs = sum(machine.pair_stiffness(places + k) for k in range(-1, 4))
    np.testing.assert_allclose(machine.mesh_stiffness(places), pairs, rtol=1e-9)
    assert report["contact_ratio"] > 1.0


def test_ref_mean_stiffness_is_scipys_integral_of_the_curve(machine):
    integral, _ = quad(lambda s: float(machine.mesh_stiffness(s)), 0.0, 1.0, limit=400, epsrel=1e-8)
    assert machine.stiffness()["used"]["mean"] == pytest.approx(integral, rel=1e-5)


def test_ref_natural_frequencies_are_scipys_eigenvalues(machine):
    """The same machine assembled here, solved by scipy.linalg.eigh."""
    from scipy.linalg import eigh

    d, report = machine.to_dict(), machine.stiffness()
    s, (r1, r2), k = d["shafts"], report["base_radius_m"], report["used"]["mean"]
    inertias = ["inertia_motor_kg_m2", "inertia_pinion_kg_m2", "inertia_gear_kg_m2", "inertia_load_kg_m2"]
    mass = np.diag([*(s[name] for name in inertias), *s["mass_kg"], *s["mass_kg"]])
    stiffness = np.zeros((8, 8))
    for (i, j), c in zip([(0, 1), (2, 3)], s["coupling_stiffness_n_m_per_rad"]):
        stiffness[np.ix_([i, j], [i, j])] += c * np.array([[1, -1], [-1, 1]])
    for i, b in zip(range(4, 8), s["bearing_stiffness_n_per_m"] * 2):
        stiffness[i, i] += b
    mesh = np.array([0, r1, -r2, 0, 1, -1, 0, 0])
    stiffness += k * np.outer(mesh, mesh)
    expected = np.sqrt(np.abs(eigh(stiffness, mass, eigvals_only=True)[1:])) / (2 * np.pi)
    np.testing.assert_allclose(machine.natural_frequencies_hz(), expected, rtol=1e-6)


def test_fault_errors_are_the_commands_one_line(root):
    with pytest.raises(meshband.FileError, match="nowhere.toml"):
        meshband.Machine.read("nowhere.toml")
    text = (root / "machines" / "17-38.toml").read_text().replace("poisson = 0.3", "poisson = 3.0")
    with pytest.raises(meshband.InvalidInput) as caught:
        meshband.Machine.from_toml(text)
    assert "poisson" in str(caught.value) and "\n" not in str(caught.value)
    assert isinstance(caught.value, ValueError)


def test_law_is_within_its_uncertainty_of_its_own_points(machine):
    law = machine.law((5.0, 20.0))
    points = law.fit["laws"]["points"]
    speeds = np.array([p["shaft_hz"] for p in points])
    bandwidths = np.array([p["bandwidth_hz"] for p in points])
    assert np.all(np.abs(law.bandwidth_hz(speeds) / bandwidths - 1) < max(3 * law.relative_uncertainty, 0.03))
    again = meshband.Law.from_toml(law.to_toml())
    assert again.bandwidth_hz(10.0) == law.bandwidth_hz(10.0)
    assert "<iframe" in law._repr_html_()
