"""Both notebooks run to their end in a kernel of this environment; the loop in one of them says what the command says."""

import functools
import json
import subprocess
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
FOLDER = Path(__file__).resolve().parents[1] / "notebooks"

# What a notebook's last cell leaves for the tests here.
TOLD = {"own-recording.ipynb": "import json\nprint(json.dumps({'folder': str(folder / 'gearbox'), 'loop': verdict.to_dict()}))"}


@functools.cache
def executed(name):
    """The notebook with its outputs, and one cell more where a test asks what it holds."""
    notebook = nbformat.read(FOLDER / name, as_version=4)
    notebook.cells += [nbformat.v4.new_code_cell(TOLD[name])] if name in TOLD else []
    nbclient.NotebookClient(notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(FOLDER)}}).execute()
    return notebook


@pytest.mark.parametrize("name", sorted(path.name for path in FOLDER.glob("*.ipynb")))
def test_notebook_runs_to_its_end(name):
    outputs = [output for cell in executed(name).cells if cell.cell_type == "code" for output in cell.outputs]
    assert any("text/html" in output.get("data", {}) for output in outputs), "a report is shown"
    assert any("image/png" in output.get("data", {}) for output in outputs), "a plot is shown"


def test_golden_the_loop_of_a_notebook_is_the_commands(command, tmp_path):
    told = json.loads("".join(output.text for output in executed("own-recording.ipynb").cells[-1].outputs))
    written = tmp_path / "loop.json"
    subprocess.run([command, "loop", told["folder"], "--json", written], check=True, capture_output=True)
    assert json.loads(written.read_text()) == told["loop"]
