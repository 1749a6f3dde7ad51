"""Cameras service: pictures rendered off screen from the poses of a tick; `core.CamerasCore` is the participant.

From outside: `core` and `ports` by the runtime; `offscreen` by whoever draws a MuJoCo scene.
"""
