"""Files of the system that root can read, and not everybody may."""

import pytest

from gslcosim.runtime.processes.sandbox.policy import list_private_system_paths


@pytest.mark.parametrize(
    ("name", "mode", "is_private"),
    [
        ("shadow", 0o640, True),
        ("sudoers", 0o440, True),
        ("ssh/ssh_host_ed25519_key", 0o600, True),
        ("app/settings/secrets.env", 0o660, True),
        ("passwd", 0o644, False),
        ("ssh/ssh_host_ed25519_key.pub", 0o644, False),
        ("lib/installed.so", 0o750, False),
    ],
)
def test_a_file_is_private_by_its_mode_wherever_it_lies_but_among_libraries(tmp_path, name, mode, is_private):
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    path.chmod(mode)
    assert list_private_system_paths((str(tmp_path),)) == ((path,) if is_private else ())


@pytest.mark.parametrize("mode", [0o700, 0o710, 0o750])
def test_a_closed_folder_is_private_with_all_in_it(tmp_path, mode):
    (tmp_path / "ssl" / "private").mkdir(parents=True)
    (tmp_path / "ssl" / "private" / "readable.key").touch(0o644)
    (tmp_path / "ssl" / "private").chmod(mode)
    # What a link leads to is granted, or not, where it lies.
    (tmp_path / "ssl" / "link").symlink_to(tmp_path / "ssl" / "private")
    assert list_private_system_paths((str(tmp_path),)) == (tmp_path / "ssl" / "private",)


def test_a_folder_that_is_not_there_has_none():
    assert list_private_system_paths(("/nowhere",)) == ()
