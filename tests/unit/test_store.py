"""Stores: what is finished is there whole, is found again, and is done once however many programs work."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asking import asked

import skyscatter
from skyscatter.cli.main import main
from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.solvers.render import picture_of
from skyscatter.tasks import claims as claims_module
from skyscatter.tasks import store as store_module
from skyscatter.tasks.claims import Claims
from skyscatter.tasks.store import Store, damaged

RECIPE = {"size": [2, 3], "options": {"samples": 64, "seed": 1}}
CAMERA = skyscatter.Panorama(width=16, height=8)


def values(number: int, width: int = 3) -> dict[str, Any]:
    return {"radiance": np.full((4, width), number + 0.5), "samples": np.full((4, 1), 7.0)}


def scene() -> Any:
    return skyscatter.load_model("earth-simple").scene(sun_elevation_deg=30)


def test_what_is_put_is_found_again(tmp_path: Path) -> None:
    store = Store(tmp_path / "run.zarr", RECIPE)
    assert store.get(0, 4) is None
    store.put(1, 4, values(1), tasks=3, rows=5)
    store.close()
    again = Store(tmp_path / "run.zarr", RECIPE)
    found = again.get(1, 4)
    assert found is not None
    assert found[0] == 4
    np.testing.assert_array_equal(found[1]["radiance"], values(1)["radiance"])
    assert again.numbers() == [1]
    assert again.tasks() == 3
    assert again.get(0, 4) is None


def test_another_recipe_is_refused_and_samples_may_grow(tmp_path: Path) -> None:
    Store(tmp_path / "run.zarr", RECIPE, ("samples",)).close()
    more = {"size": [2, 3], "options": {"samples": 256, "seed": 1}}
    Store(tmp_path / "run.zarr", more, ("samples",)).close()
    for name, other in {"size": {**RECIPE, "size": [3, 2]}, "options": {**RECIPE, "options": {"seed": 2}}}.items():
        with pytest.raises(DomainError, match=f"other {name}"):
            Store(tmp_path / "run.zarr", other, ("samples",))


def test_other_folders_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    with pytest.raises(DomainError, match="no store"):
        Store(tmp_path / "mine", RECIPE)
    assert (tmp_path / "mine" / "thesis.txt").read_text() == "years of work"
    with pytest.raises(DomainError, match="directory does not exist"):
        Store(tmp_path / "no" / "run.zarr", RECIPE)


@pytest.mark.parametrize("how", ["flipped", "cut", "empty"])
def test_damage_is_seen_and_done_again(how: str, tmp_path: Path) -> None:
    store = Store(tmp_path / "run.zarr", RECIPE)
    for k in range(3):
        store.put(k, 1, values(k), 3, 4)
    chunk = store._chunk(store._open(), 1)
    raw = bytearray(chunk.read_bytes())
    raw[len(raw) // 2] ^= 255
    chunk.write_bytes({"flipped": bytes(raw), "cut": bytes(raw[:-9]), "empty": b""}[how])
    assert [number for number, _ in damaged(store)] == [1]
    assert store.get(1, 4) is None
    assert store.get(2, 4) is not None
    store.put(1, 1, values(1), 3, 4)
    assert not list(damaged(store))


def test_a_chunk_in_the_wrong_place_is_seen(tmp_path: Path) -> None:
    store = Store(tmp_path / "run.zarr", RECIPE)
    for k in range(2):
        store.put(k, 1, values(k), 2, 4)
    array = store._open()
    store._chunk(array, 0).write_bytes(store._chunk(array, 1).read_bytes())
    assert store.get(0, 4) is None
    assert [number for number, _ in damaged(store)] == [0]


def test_a_full_disk_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = Store(tmp_path / "run.zarr", RECIPE)
    monkeypatch.setattr(store_module, "AGAIN", 0.01)
    tries = [0]

    def full(*_: Any) -> None:
        tries[0] += 1
        if tries[0] < 4:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(store, "_write", full)
    store.put(0, 1, values(0), 1, 4)
    assert tries[0] == 4
    monkeypatch.setattr(store_module, "PATIENCE", 0.0)
    tries[0] = -99
    with pytest.raises(SkyscatterError, match="the disk is full"):
        store.put(0, 1, values(0), 1, 4)


def test_one_of_many_gets_a_claim(tmp_path: Path) -> None:
    everybody = [Claims(tmp_path) for _ in range(8)]
    with ThreadPoolExecutor(8) as pool:
        got = list(pool.map(lambda claims: [claims.take(f"{k}") for k in range(50)], everybody))
    assert np.array(got).sum(axis=0).tolist() == [1] * 50
    everybody[int(np.argmax(np.array(got)[:, 0]))].give_back("0")
    assert everybody[0].take("0")


def test_claims_of_the_dead_are_taken_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = f"from skyscatter.tasks.claims import Claims; import os; Claims({str(tmp_path)!r}).take('5'); os._exit(9)"
    subprocess.run([sys.executable, "-c", code], check=False)
    assert Claims(tmp_path).take("5"), "its process has ended on this machine"
    far = tmp_path / "6.claim"
    far.write_text("far-away.1.abc")
    (tmp_path / "far-away.1.abc.alive").touch()
    assert not Claims(tmp_path).take("6"), "it has just given a sign"
    os.utime(tmp_path / "far-away.1.abc.alive", (0, 0))
    assert Claims(tmp_path).take("6"), "it gives none"
    monkeypatch.setattr(claims_module, "SILENCE", -1.0)
    own = Claims(tmp_path)
    assert own.take("7")
    assert not own.take("7"), "the own one is alive whatever the clock says"


SOLVERS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("single", {}), ("orders", {"tolerance": 0.02}), ("path", {"samples": 16}),
)  # fmt: skip


@pytest.mark.parametrize(("solver", "options"), SOLVERS)
def test_pictures_by_way_of_a_store(solver: str, options: dict[str, Any], tmp_path: Path) -> None:
    def made(**more: Any) -> Any:
        return skyscatter.render(scene(), CAMERA, [450, 650], parts=True, **asked(solver, **options, **more))

    plain = made()
    for _ in range(2):
        kept = made(store=tmp_path / "a.zarr")
        exported = picture_of(tmp_path / "a.zarr")
        for image in (kept, exported):
            np.testing.assert_array_equal(image.radiance, plain.radiance)
            np.testing.assert_array_equal(image.standard_error, plain.standard_error)
            assert set(image.layers) == set(plain.layers)
    assert exported.recipe == json.loads(json.dumps(plain.recipe))


def test_walks_are_added_to_the_same_digits(tmp_path: Path) -> None:
    def made(samples: int, **more: Any) -> Any:
        return skyscatter.render(
            scene(), CAMERA, [450, 650], stokes=True, orders=2, parts=True, **asked("path", samples=samples, **more)
        )

    made(32, store=tmp_path / "a.zarr")
    more, plain = made(96, store=tmp_path / "a.zarr"), made(96)
    fewer = made(32, store=tmp_path / "a.zarr")
    for image in (more, fewer):
        np.testing.assert_array_equal(image.radiance, plain.radiance)
        np.testing.assert_array_equal(image.standard_error, plain.standard_error)
        for name in plain.layers:
            np.testing.assert_array_equal(image.layers[name], plain.layers[name])
        assert image.recipe["options"]["samples"] == 96, "what it is made of, and not what was asked for"


def test_two_programs_share_the_work(tmp_path: Path) -> None:
    from skyscatter.solvers import stored

    numbers: list[int] = []
    put = Store.put

    def made(**more: Any) -> Any:
        return skyscatter.render(scene(), CAMERA, [550], **asked("path", samples=64, **more))

    def counted(self: Store, task: int, *rest: Any) -> None:
        numbers.append(task)
        put(self, task, *rest)

    def work(_: int) -> Any:
        return made(store=tmp_path / "a.zarr", threads=1)

    with pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(2) as pool:
        patch.setattr(stored.Store, "put", counted)
        one, two = pool.map(work, range(2))
    np.testing.assert_array_equal(one.radiance, two.radiance)
    assert sorted(numbers) == sorted(set(numbers)), "nothing was done twice"
    np.testing.assert_array_equal(one.radiance, made().radiance)


@pytest.mark.parametrize(
    "options",
    [{"noise": 0.1}, {"samples": 8}, {"samples": 16, "sampling": "free-flight"}],
    ids=lambda given: next(iter(given)),
)
def test_walks_without_sums_are_kept_as_they_are(options: dict[str, Any], tmp_path: Path) -> None:
    def made(**more: Any) -> Any:
        return skyscatter.render(scene(), CAMERA, [450, 650], **asked("path", **{**options, **more}))

    kept, plain = made(store=tmp_path / "a.zarr"), made()
    np.testing.assert_array_equal(kept.radiance, plain.radiance)
    np.testing.assert_array_equal(kept.standard_error, plain.standard_error)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Store, "put", lambda *_: pytest.fail("nothing is made twice"))
        np.testing.assert_array_equal(made(store=tmp_path / "a.zarr").radiance, plain.radiance)
    np.testing.assert_array_equal(picture_of(tmp_path / "a.zarr").radiance, plain.radiance)
    more = {"noise": 0.05} if "noise" in options else {"samples": 64}
    with pytest.raises(DomainError, match="other options"):
        made(store=tmp_path / "a.zarr", **more)


def test_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run, png = tmp_path / "run.zarr", tmp_path / "sky.png"
    words = ["sky", "earth-simple", "--size", "16x8", "--solver", "single", "--wavelengths", "450,550,650", "-q"]
    assert main([*words, "--store", str(run), "-o", str(png)]) == 0
    assert main(["store", "list", str(run), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["finished"] == summary["tasks"] > 0
    assert main(["store", "list", str(run)]) == 0
    assert main(["store", "verify", str(run)]) == 0
    assert main(["store", "export", str(run), "-o", str(tmp_path / "again.png")]) == 0
    assert (tmp_path / "again.png").read_bytes() == png.read_bytes()
    store = Store(run, store_module.read_attributes(run)["recipe"])
    store._chunk(store._open(), 0).write_bytes(b"nonsense")
    assert main(["store", "verify", str(run)]) == 2
    assert "task 0" in capsys.readouterr().out
    assert main(["store", "verify", str(run), "--repair"]) == 0
    assert main([*words, "--store", str(run), "-o", str(png)]) == 0
    assert main(["store", "verify", str(run)]) == 0
    for bad in (["store", "list", str(tmp_path)], [*words, "--store", str(run), "--checkpoint", "1min"]):
        assert main(bad) == 2
        assert capsys.readouterr().err.count("\n") == 1
