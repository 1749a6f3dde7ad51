"""Probe of this machine's graphics drivers, run as a separate process, as drivers may crash.

`python -m gslcosim.cli.rendering_probe` prints JSON: availability of `vulkan` and `egl`, and as `text` the devices, the
version or the reason of a failure.
"""

import ctypes
import ctypes.util
import json
import sys

_VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO = 1
# VkPhysicalDeviceProperties begins with five 32-bit numbers, followed by the device's name. The rest is below 2 kB.
_VK_NAME_OFFSET = 20
_VK_PROPERTIES_BYTES = 2048
_EGL_PLATFORM_SURFACELESS_MESA = 0x31DD


class _InstanceCreateInfo(ctypes.Structure):
    _fields_ = (
        ("s_type", ctypes.c_int),
        ("next", ctypes.c_void_p),
        ("flags", ctypes.c_uint32),
        ("application_info", ctypes.c_void_p),
        ("n_layers", ctypes.c_uint32),
        ("layers", ctypes.c_void_p),
        ("n_extensions", ctypes.c_uint32),
        ("extensions", ctypes.c_void_p),
    )


def vulkan_devices() -> list[str]:
    """Return the names of the Vulkan devices."""
    vulkan = ctypes.CDLL(_library("vulkan", "libvulkan.so.1"))
    info = _InstanceCreateInfo(s_type=_VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO)
    instance = ctypes.c_void_p()
    if code := vulkan.vkCreateInstance(ctypes.byref(info), None, ctypes.byref(instance)):
        raise OSError(f"no Vulkan driver (vkCreateInstance returned {code})")
    count = ctypes.c_uint32()
    vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    devices = (ctypes.c_void_p * count.value)()
    vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), devices)
    names: list[str] = []
    for device in devices:
        properties = ctypes.create_string_buffer(_VK_PROPERTIES_BYTES)
        vulkan.vkGetPhysicalDeviceProperties(ctypes.c_void_p(device), properties)
        names.append(properties.raw[_VK_NAME_OFFSET:].partition(b"\0")[0].decode(errors="replace"))
    vulkan.vkDestroyInstance(instance, None)
    if not names:
        raise OSError("no Vulkan device")
    return names


def egl_version() -> str:
    """Return the version of EGL, initialised without a display."""
    egl = ctypes.CDLL(_library("EGL", "libEGL.so.1"))
    egl.eglGetPlatformDisplay.restype = ctypes.c_void_p
    display = ctypes.c_void_p(egl.eglGetPlatformDisplay(_EGL_PLATFORM_SURFACELESS_MESA, None, None))
    major, minor = ctypes.c_int(), ctypes.c_int()
    if not display or not egl.eglInitialize(display, ctypes.byref(major), ctypes.byref(minor)):
        raise OSError("EGL cannot be initialised without a display")
    egl.eglTerminate(display)
    return f"{major.value}.{minor.value}"


def _library(name: str, usual: str) -> str:
    return ctypes.util.find_library(name) or usual


def main() -> None:
    """Print the results as JSON."""
    found: dict[str, object] = {}
    for name, probe in (("vulkan", vulkan_devices), ("egl", egl_version)):
        try:
            found[name] = {"is_there": True, "text": probe()}
        except (OSError, AttributeError) as error:
            found[name] = {"is_there": False, "text": str(error)}
    sys.stdout.write(json.dumps(found))


if __name__ == "__main__":
    main()
