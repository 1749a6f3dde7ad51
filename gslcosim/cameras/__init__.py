"""Cameras: what they see of room and vehicles, rendered off screen from the poses of a tick; see `core.CamerasCore`.

From outside: `core` and `ports` by the runtime; `offscreen` by whoever draws a MuJoCo scene.
"""
