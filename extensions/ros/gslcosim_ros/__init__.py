"""ROS 2 without ROS: message types, and nodes in a graph over Zenoh as `rmw_zenoh` has them.

`types` makes messages and writes them as CDR, `wire` has the keys, names, hashes and attachments of `rmw_zenoh`, and
`node` opens a session in a ROS graph whose nodes publish, subscribe, and answer and call services; `actions` builds
actions of these.
Nothing here knows of runs.
"""
