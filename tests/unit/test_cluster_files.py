"""Files for clusters, as far as they can be looked at without one."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
CLUSTER = ROOT / "examples" / "cluster"

bash = pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")


def test_pods_are_found_and_their_commands_exist() -> None:
    """Selectors name the labels of their pods, the service is where workers and users look, dask knows the options."""
    yaml = pytest.importorskip("yaml")
    commands = {
        "scheduler": pytest.importorskip("distributed.cli.dask_scheduler").main,
        "worker": pytest.importorskip("distributed.cli.dask_worker").main,
    }
    service, *pods = yaml.safe_load_all((CLUSTER / "kubernetes.yaml").read_text())
    labels: dict[str, Any] = {}
    for pod in pods:
        found = pod["spec"]["template"]["metadata"]["labels"]
        assert pod["spec"]["selector"]["matchLabels"].items() <= found.items()
        labels[found["role"]] = found
        for container in pod["spec"]["template"]["spec"]["containers"]:
            dask, command, *options = container["command"]
            assert (dask, command) == ("dask", found["role"])
            known = {name for option in commands[command].params for name in (*option.opts, *option.secondary_opts)}
            assert {word for word in options if word.startswith("--")} <= known
            if command == "worker":
                port = service["spec"]["ports"][0]["port"]
                assert f"tcp://{service['metadata']['name']}:{port}" in options
                asked = re.fullmatch(r"(\d+)MB", options[options.index("--memory-limit") + 1])
                given = re.fullmatch(r"(\d+)Gi", container["resources"]["limits"]["memory"])
                assert asked is not None
                assert given is not None
                assert int(asked[1]) * 1e6 < int(given[1]) * 2**30, "dask ends a task before Kubernetes ends the pod"
    assert service["spec"]["selector"].items() <= labels["scheduler"].items()


def array_job() -> str:
    """The script of the how-to."""
    text = (ROOT / "docs" / "howto-cluster.md").read_text()
    found = re.search(r"^#!/bin/bash\n.*?(?=^```)", text, re.MULTILINE | re.DOTALL)
    assert found is not None
    return found[0]


@bash
def test_an_array_of_jobs_goes_on(tmp_path: Path) -> None:
    """It begins, goes on from what was kept, and passes over what is finished; a stand-in says what it was asked."""
    stand_in = tmp_path / "bin" / "skyscatter"
    stand_in.parent.mkdir()
    stand_in.write_text('#!/bin/bash\nprintf "%s\\n" "$@" > asked\n')
    stand_in.chmod(0o755)
    given = {"SLURM_ARRAY_TASK_ID": "3", "SLURM_CPUS_PER_TASK": "8"}
    environment = {**os.environ, **given, "PATH": f"{stand_in.parent}:{os.environ['PATH']}"}

    def asked() -> list[str]:
        (tmp_path / "asked").unlink(missing_ok=True)
        subprocess.run(["bash", "-eu", "-c", array_job()], cwd=tmp_path, env=environment, check=True)
        return (tmp_path / "asked").read_text().split() if (tmp_path / "asked").exists() else []

    words = asked()
    assert words[words.index("--sun-elevation") + 1] == "7"
    assert "--resume" not in words
    (tmp_path / "sky-07.nc.partial.zarr").mkdir()
    words = asked()
    assert words[words.index("--resume") + 1] == "sky-07.nc.partial.zarr"
    (tmp_path / "sky-07.nc").write_text("finished")
    assert asked() == []


@bash
@pytest.mark.slow
def test_the_script_that_slurm_would_get(tmp_path: Path) -> None:
    """By dask-jobqueue, where that is installed."""
    pytest.importorskip("dask_jobqueue")
    import sys

    words = [sys.executable, str(CLUSTER / "slurm.py"), "--queue", "batch", "--show"]
    script = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    subprocess.run(["bash", "-n", "-c", script], check=True)
    assert "#SBATCH -p batch" in script
    assert "skyscatter warm" in script
    assert "--lifetime 110m" in script
