"""Checkpoints: what was kept comes back, and what is none is refused."""

import numpy as np
import pytest

from gslcosim.base.errors import UsageError
from gslcosim_training.training_run import CHECKPOINT, Checkpoint, load_checkpoint, save_checkpoint


def kept(folder):
    arrays = {"told": np.arange(6.0).reshape(2, 3)}
    save_checkpoint(folder, Checkpoint(identity="a", trainer=arrays, best={"values": np.ones(2)}, about={"n": 1}))
    return folder / CHECKPOINT


def test_a_checkpoint_comes_back(tmp_path):
    kept(tmp_path)
    found = load_checkpoint(tmp_path, identity="a")
    assert np.array_equal(found.trainer["told"], np.arange(6.0).reshape(2, 3))
    assert np.array_equal(found.best["values"], [1, 1])
    assert found.about == {"n": 1}


@pytest.mark.parametrize("damage", [lambda b: b[:40], lambda b: b"", lambda b: b[:90] + b"\xff\x00" * 9 + b[108:]])
def test_a_corrupt_checkpoint_is_refused_by_its_name(tmp_path, damage):
    path = kept(tmp_path)
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(
        UsageError, match=r"checkpoint.npz: expected a checkpoint of gslcosim train, was a file that is"
    ):
        load_checkpoint(tmp_path, identity="a")


def test_a_checkpoint_of_another_train_file_is_refused(tmp_path):
    kept(tmp_path)
    with pytest.raises(UsageError, match="expected a checkpoint of this train file and family"):
        load_checkpoint(tmp_path, identity="b")


def test_no_checkpoint_is_reported(tmp_path):
    with pytest.raises(UsageError, match=r"found none\. Leave out --resume"):
        load_checkpoint(tmp_path, identity="a")
