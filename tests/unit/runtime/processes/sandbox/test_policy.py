"""Every sandbox reads the code that agents import."""

from gslcosim.base.extension_packages import find_extension_packages
from gslcosim.runtime.processes.sandbox.policy import list_python_folders


def test_packages_of_extensions_are_read_wherever_they_are_installed():
    folders = list_python_folders()
    for package in find_extension_packages().values():
        assert any(package.is_relative_to(folder) for folder in folders), package
