"""The cache, hashes and atomic writes under damage, races and full disks."""

import os
import stat
import subprocess
import sys

import numpy as np
import pytest
from refusals import refused
from tables import table

from dexgrasp.agents.learned import LearnedAgent
from dexgrasp.evaluation.scoring.hand import find_hand
from dexgrasp_env import files
from dexgrasp_env.files import cached_arrays, write_atomically
from dexgrasp_env.objects.load import load_object
from dexgrasp_env.yaml_file import read_yaml


def made():
    return {"points": np.arange(12.0).reshape(4, 3), "names": np.array(["a", "bc"])}


def refuse():
    raise AssertionError("made again")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("DEXGRASP_CACHE", str(tmp_path / "cache"))
    files.note_unwritable.cache_clear()
    return tmp_path / "cache"


def assert_same(arrays):
    assert arrays.keys() == made().keys()
    for name, array in made().items():
        np.testing.assert_array_equal(arrays[name], array)


def test_what_was_made_is_read_back(cache):
    assert_same(cached_arrays("a/b.npy", made))
    assert_same(cached_arrays("a/b.npy", refuse))
    assert [path.name for path in (cache / "a").iterdir()] == ["b.npy"]
    for _ in range(2):
        assert not cached_arrays("empty.npy", lambda: {"none": np.zeros(0, bool)})["none"].size


def test_every_damage_is_noticed_and_replaced(cache):
    cached_arrays("b.npy", made)
    whole = (cache / "b.npy").read_bytes()
    rng = np.random.default_rng(0)
    damages = [b"", whole[:-1], whole[: len(whole) // 2], whole + b"x", b"\0" * len(whole)]
    for place in rng.integers(0, len(whole), 40):
        flipped = bytearray(whole)
        flipped[place] ^= 1 << int(rng.integers(8))
        damages.append(bytes(flipped))
    for damage in damages:
        (cache / "b.npy").write_bytes(damage)
        assert_same(cached_arrays("b.npy", made))
        assert (cache / "b.npy").read_bytes() == whole


def test_objects_are_never_pickled(cache):
    with pytest.raises(ValueError, match="allow_pickle"):
        cached_arrays("b.npy", lambda: {"a": np.array([{}], dtype=object)})
    assert not list(cache.rglob("*"))


@pytest.mark.parametrize("obstacle", ["file in the way", "full disk"])
def test_a_cache_that_cannot_be_written_is_done_without(cache, obstacle, monkeypatch, capsys):
    if obstacle == "file in the way":
        cache.write_text("")
    else:
        monkeypatch.setattr(files, "write_atomically", _full)
    for name in ("a.npy", "b.npy"):
        assert_same(cached_arrays(name, made))
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("cannot be written") == 1
    assert "DEXGRASP_CACHE" in said.err


def _full(path, data):
    raise OSError(28, "No space left on device")


@pytest.mark.parametrize(("mask", "mode"), [(0o022, 0o644), (0o027, 0o640), (0o077, 0o600)])
def test_files_have_the_mode_of_the_umask(tmp_path, mask, mode):
    before = os.umask(mask)
    try:
        write_atomically(tmp_path / "deep" / "a", b"x")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "deep" / "a").stat().st_mode) == mode


def test_the_longest_name_a_file_may_have_can_be_written(tmp_path):
    write_atomically(tmp_path / ("a" * 255), b"x")
    assert (tmp_path / ("a" * 255)).read_bytes() == b"x"


def test_processes_that_race_for_a_first_file_all_get_it(cache):
    code = (
        "import numpy as np; from dexgrasp_env.files import cached_arrays\n"
        "for k in range(200):\n"
        "    a = cached_arrays(f'{k}.npy', lambda: {'a': np.full(1000, k)})['a']\n"
        "    assert len(a) == 1000 and (a == k).all()\n"
    )
    racers = [subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE) for _ in range(2)]
    for racer in racers:
        assert racer.communicate()[1] == b""
        assert racer.returncode == 0
    assert len(list(cache.iterdir())) == 200


# -- archives of others -----------------------------------------------------------------------------------------


def test_a_folder_of_nobody_is_one_line():
    for read in (files.expand, LearnedAgent, find_hand, load_object):
        with refused(r"no such user|does not exist"):
            read("~nobody_of_that_name/file.xml" if read is not load_object else "~nobody_of_that_name/a.obj")


@pytest.mark.parametrize(("text", "value"), table("numbers_of_yaml"))
def test_numbers_with_exponents_are_numbers(tmp_path, text, value):
    (tmp_path / "x.yaml").write_text(f"a: {text}\nb: '{text}'\nc: 1e-x\n")
    assert read_yaml(tmp_path / "x.yaml") == {"a": value, "b": text, "c": "1e-x"}


def test_yaml_is_that_of_1_2(tmp_path):
    text = (
        "a: 010\nb: 0o10\nc: 1:30\nd: on\ne: true\nf: 0x1F\ng: 2026-01-01\nh: &h {x: 1}\ni: {<<: *h, y: ~}\n"
    )
    (tmp_path / "x.yaml").write_text(text, encoding="utf-16")
    assert read_yaml(tmp_path / "x.yaml") == table("yaml_of_1_2")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a:\n\tb: 1", r"line 2: .*character '\\t'"),
        ("&a [*a]", "it holds itself"),
        ("a0: &a0 [1]\n" + "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 9)),
         "unfolds to over"),
    ],
)  # fmt: skip
def test_yaml_that_is_none_says_where(tmp_path, text, words):
    (tmp_path / "x.yaml").write_text(text)
    with refused(words):
        read_yaml(tmp_path / "x.yaml")


def test_a_key_that_stands_twice_is_refused_by_its_name(tmp_path):
    (tmp_path / "x.yaml").write_text("limits:\n  torque: 1\n  velocity: 2\n  torque: 3\n")
    with refused("key 'torque' stands twice in the mapping of line 2"):
        read_yaml(tmp_path / "x.yaml")
