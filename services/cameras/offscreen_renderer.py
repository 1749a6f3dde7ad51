"""Offscreen renderer of a MuJoCo scene: EGL where there is one, else OSMesa.

`python -m gslcosim_services.cameras.offscreen_renderer` tests this machine's driver in a process of its own: exit code
0, or 1 with the reason.
"""
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false

import importlib
import os
import sys
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import ModelError

# Modules of MuJoCo with a `GLContext`, in the order in which they are tried, and the package of Debian for each.
_BACKEND_PACKAGES = {"egl": "libegl1 libgl1-mesa-dri", "osmesa": "libosmesa6"}
_MAX_GEOMS = 20_000
_PROBE_PX = 8


class OffscreenRenderer:
    """Draws one scene in pictures of up to a given size. It holds driver's memory until `close`.

    Shadows, reflections and smoothed edges are off: they cost much without a GPU, and drivers differ in them.
    """

    def __init__(self, model: mujoco.MjModel, width_px: int, height_px: int) -> None:
        """Create an offscreen context."""
        self._model = model
        self._gl: Any = _open_context(width_px, height_px)
        self._gl.make_current()
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        self._scene = mujoco.MjvScene(model, maxgeom=_MAX_GEOMS)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[flag] = 0
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._option = mujoco.MjvOption()

    def colors(self, data: mujoco.MjData, camera: int, width_px: int, height_px: int) -> NDArray[np.uint8]:
        """Return the (height, width, 3) picture that a camera of the model sees, upper row first."""
        picture = np.empty((height_px, width_px, 3), np.uint8)
        mujoco.mjr_readPixels(picture, None, self._render(data, camera, width_px, height_px), self._context)
        return np.flipud(picture)

    def depths_m(self, data: mujoco.MjData, camera: int, width_px: int, height_px: int) -> NDArray[np.float64]:
        """Return the (height, width) depths along the optical axis [m], upper row first.

        The depth buffer is reversed: b = n (f - d) / (d (f - n)), so d = n f / (b (f - n) + n); n near, f far plane.
        """
        buffer = np.empty((height_px, width_px), np.float32)
        mujoco.mjr_readPixels(None, buffer, self._render(data, camera, width_px, height_px), self._context)
        extent_m, planes = self._model.stat.extent, self._model.vis.map
        near_m, far_m = planes.znear * extent_m, planes.zfar * extent_m
        return near_m * far_m / (np.flipud(buffer).astype(np.float64) * (far_m - near_m) + near_m)

    def close(self) -> None:
        """Release the driver's memory."""
        self._gl.make_current()
        self._context.free()
        self._gl.free()

    def _render(self, data: mujoco.MjData, camera: int, width_px: int, height_px: int) -> mujoco.MjrRect:
        self._gl.make_current()
        self._camera.fixedcamid = camera
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, data, self._option, None, self._camera, everything, self._scene)
        rect = mujoco.MjrRect(0, 0, width_px, height_px)
        mujoco.mjr_render(rect, self._scene, self._context)
        return rect


# Drivers and their bindings fail in many ways: at import, at the first call, or by returning nothing.
def _open_context(width_px: int, height_px: int) -> Any:
    reasons: list[str] = []
    for way in _BACKEND_PACKAGES:
        before = os.environ.get("PYOPENGL_PLATFORM")
        try:
            context = importlib.import_module(f"mujoco.{way}").GLContext(width_px, height_px)
        except Exception as error:
            reasons.append(f"{way}: {error}")
            if before is None:
                os.environ.pop("PYOPENGL_PLATFORM", None)
                # OpenGL's bindings keep the platform of their first import, even if it does not work.
                for name in [name for name in sys.modules if name.partition(".")[0] == "OpenGL"]:
                    del sys.modules[name]
            continue
        # MuJoCo takes the library of its OpenGL functions from here.
        os.environ["MUJOCO_GL"] = way
        return context
    raise ModelError(
        f"cameras: expected EGL or OSMesa to draw with, was none ({'; '.join(reasons)}). "
        f"On Debian: sudo apt-get install {', or '.join(_BACKEND_PACKAGES.values())}."
    )


def main() -> None:
    """Exit with 0 if this machine can draw, with the reason otherwise."""
    try:
        _open_context(_PROBE_PX, _PROBE_PX).free()
    except ModelError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
