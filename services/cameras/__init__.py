"""Cameras service: pictures rendered off screen from the poses of a tick; `core.CamerasCore` is the participant.

`offscreen_renderer` draws any MuJoCo scene.
"""
