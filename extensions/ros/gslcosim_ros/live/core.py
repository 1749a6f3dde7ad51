"""Bridge to ROS 2: reads what agents get, and publishes it as topics of a node."""

import time
from collections.abc import Callable, Mapping
from typing import Any, cast

import numpy as np

from gslcosim.base.frames import quaternion_from_yaw, world_from_body_rotation
from gslcosim.base.ticks import NS_PER_S, exact_ticks_from_seconds, seconds_from_ticks
from gslcosim.contract import keys
from gslcosim.contract.messages import (
    BodyPoses,
    Command,
    FieldSamples,
    FilamentCloud,
    Observation,
    Reading,
)
from gslcosim.contract.participant import Episode, Inbox, Outbox
from gslcosim.environment.model import Environment
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.scenario.models.sensors import (
    CameraSensorSpec,
    DepthCameraSpec,
    LidarSensorSpec,
    RaySensorSpec,
    SensorSpec,
)
from gslcosim_ros.live import messages
from gslcosim_ros.live.service import ros2_spec
from gslcosim_ros.node import RosPublisher, RosSession
from gslcosim_ros.scenario_keys import LIVE_TOPICS, Ros2Spec
from gslcosim_ros.types import ANEMOMETER, GAS_SENSOR, MAP_FRAME, RosTypes
from gslcosim_services.recorder.entities import is_wind_sensor, list_gas_names
from gslcosim_services.recorder.stream_table import ON_BOARD_STREAMS
from gslcosim_services.sensing.briefing import find_sensor_kind
from gslcosim_services.sensing.models.range_finders import ray_directions_body

NODE_NAME = "gslcosim"
_TRACK_PERIOD_NS = NS_PER_S
Publish = Callable[..., None]


class Ros2Core:
    """Publishes a run as topics of the ROS 2 node `/gslcosim`: what agents get, the map, and the truth if asked for.

    Writes nothing to the run, so that its results are the same with it and without. Poses are the agents' own
    estimates, as their observations have them. What nobody subscribes to is not even made; `/map`, `/tf_static`,
    `/sources`, descriptions of vehicles and waypoints are kept for those who come later. Nothing is published after the
    verdict. It reads the clock, for `/clock` is limited by it; snapshots hold nothing of it.

    Raises UsageError where the extension `ros` is missing, or where it finds no place in a graph.
    """

    def __init__(self, scenario: Scenario, environment: Environment, *, types: RosTypes | None = None) -> None:
        """Prepare a bridge.

        Args:
            scenario: What is run, with its block `ros2`.
            types: Of messages; made of the distribution where absent.
        """
        self._scenario = scenario
        self._environment = environment
        self._settings = LIVE_TOPICS.get(scenario) or Ros2Spec()
        self._types = types or RosTypes(self._settings.distro)
        self.spec = ros2_spec(scenario)
        self._session: RosSession | None = None
        self._topics: dict[str, RosPublisher] = {}
        self._agents: list[_AgentTopics] = []
        self._clock_at_s = 0.0
        self._is_over = False

    def reset(self, episode: Episode) -> Outbox:
        """Join the graph, and publish what stands still."""
        self.close()
        if episode.is_warmup:
            return {}
        settings, types, scenario = self._settings, self._types, self._scenario
        self._session = RosSession.open(types, endpoint=settings.endpoint, domain=settings.domain)
        node = self._session.create_node(NODE_NAME)
        self._is_over = False

        def declare(topic: str, kind: str) -> None:
            self._topics[topic] = node.create_publisher(topic, kind, messages.find_qos(topic))

        declare("/clock", "rosgraph_msgs/msg/Clock")
        declare("/tf", "tf2_msgs/msg/TFMessage")
        declare("/tf_static", "tf2_msgs/msg/TFMessage")
        declare("/map", "nav_msgs/msg/OccupancyGrid")
        self._topics["/tf_static"].publish(messages.make_mounts(types, scenario))
        self._topics["/map"].publish(messages.make_map(types, scenario, self._environment))
        self._agents = [_AgentTopics(types, scenario, agent) for agent in scenario.agents]
        for agent in self._agents:
            for topic, kind in agent.topics.items():
                declare(topic, kind)
        for agent in scenario.agents:
            topic = messages.description_topic(agent.name)
            declare(topic, "std_msgs/msg/String")
            self._topics[topic].publish(messages.make_description(types, agent))
        if settings.truth:
            declare("/sources", "visualization_msgs/msg/MarkerArray")
            self._topics["/sources"].publish(messages.make_sources(types, scenario))
            self._declare_truth(declare)
        return {}

    def _declare_truth(self, declare: Callable[..., None]) -> None:
        declare("/truth/filaments", "sensor_msgs/msg/PointCloud2")
        declare("/truth/plume", "visualization_msgs/msg/MarkerArray")
        for agent in self._scenario.agents:
            declare(f"/truth/{messages.topic_part(agent.name)}/odom", "nav_msgs/msg/Odometry")
            for sensor in agent.sensors:
                topic = f"/truth{messages.topic_of(agent.name, sensor.name)}"
                if is_wind_sensor(sensor, self._scenario):
                    declare(topic, ANEMOMETER)
                else:
                    for gas in list_gas_names(self._scenario):
                        declare(f"{topic}/{messages.topic_part(gas)}", GAS_SENSOR)

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Publish what is known of this tick."""
        if self._session is None or self._is_over:
            return {}
        time_ns = tick * self._scenario.tick_ns
        self._is_over = keys.VERDICT in inbox
        self._publish_clock(time_ns)
        transforms: list[Any] = []
        for agent in self._agents:
            observation = cast(Observation | None, inbox.get(keys.observation(agent.name)))
            if observation is not None:
                transforms.append(agent.locate(time_ns, observation))
                agent.publish_observation(tick, time_ns, observation, self._publish)
            command = cast(Command | None, inbox.get(keys.command(agent.name)))
            if command is not None:
                agent.publish_command(time_ns, command, self._publish)
        self._publish("/tf", lambda: self._types.make("tf2_msgs/msg/TFMessage", transforms=transforms))
        if self._settings.truth:
            self._publish_truth(time_ns, inbox)
        return {}

    # Faster than real time, nodes that take every stamp would do nothing else.
    def _publish_clock(self, time_ns: int) -> None:
        now_s = time.monotonic()
        if self._is_over or now_s - self._clock_at_s >= 1.0 / self._settings.clock_hz:
            self._clock_at_s = now_s
            types = self._types
            self._publish("/clock", lambda: types.make("rosgraph_msgs/msg/Clock", clock=types.time(time_ns)))

    def _publish(self, topic: str, make: Callable[[], Any], *, is_kept: bool = False) -> None:
        assert self._session is not None
        if is_kept or self._session.has_subscriber(topic):
            self._topics[topic].publish(make())

    def _publish_truth(self, time_ns: int, inbox: Inbox) -> None:
        types = self._types
        bodies = cast(BodyPoses | None, inbox.get(keys.BODIES))
        for body in bodies.bodies if bodies is not None else ():
            position_m, turn = np.array(body.position_world_m), np.array(body.quaternion_wxyz)
            velocity_m_s = world_from_body_rotation(body.quaternion_wxyz).T @ np.array(body.velocity_world_m_s)
            rates_rad_s = np.array(body.angular_velocity_body_rad_s)
            self._publish(
                f"/truth/{messages.topic_part(body.agent)}/odom",
                lambda body=body, at=position_m, turn=turn, v=velocity_m_s, w=rates_rad_s: messages.make_odometry(
                    types, time_ns, body.agent, at, turn, v, w
                ),
            )
        samples = cast(FieldSamples | None, inbox.get(keys.SAMPLES))
        for sample in samples.samples if samples is not None else ():
            topic, frame = (
                messages.topic_of(sample.agent, sample.sensor),
                messages.frame_of(sample.agent, sample.sensor),
            )
            if (wind_topic := f"/truth{topic}") in self._topics:
                wind_m_s = np.array(sample.wind_world_m_s)
                self._publish(
                    wind_topic,
                    lambda frame=frame, wind=wind_m_s: messages.make_true_wind(types, time_ns, frame, wind),
                )
            for gas in sample.gases:
                if (gas_topic := f"/truth{topic}/{messages.topic_part(gas.gas)}") in self._topics:
                    self._publish(
                        gas_topic,
                        lambda frame=frame, ppm=gas.mixing_ratio_ppm: messages.make_gas(
                            types, types.header(time_ns, frame), ppm
                        ),
                    )
        cloud = cast(FilamentCloud | None, inbox.get(keys.FILAMENTS))
        if cloud is not None:
            centres_m = cloud.position_world_m.to_array().reshape(-1, 3)
            sigmas_m = cloud.sigma_m.to_array().ravel()
            self._publish("/truth/filaments", lambda: messages.make_filaments(types, time_ns, centres_m, sigmas_m))
            self._publish("/truth/plume", lambda: messages.make_plume(types, time_ns, centres_m, sigmas_m))

    def close(self) -> None:
        """Leave the graph."""
        session, self._session = self._session, None
        self._topics, self._agents = {}, []
        if session is not None:
            session.close()

    def state(self) -> Mapping[str, Any]:
        """Return nothing: what it publishes depends on nothing but the messages of a tick."""
        return {}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a snapshot, of which it needs nothing."""


class _AgentTopics:
    """Topics of one agent, with their types, and the messages of a tick."""

    def __init__(self, types: RosTypes, scenario: Scenario, agent: AgentSpec) -> None:
        self.name = agent.name
        self._types = types
        self._scenario = scenario
        self._tick_s = seconds_from_ticks(1, scenario.tick_ns)
        self._root = f"/{messages.topic_part(self.name)}"
        self._sensors = {sensor.name: sensor for sensor in agent.sensors}
        self._period_ticks = {
            sensor.name: exact_ticks_from_seconds(sensor.period_s, scenario.tick_ns, name="period_s")
            for sensor in agent.sensors
            if sensor.period_s
        }
        self._clean_air_ohm: dict[str, float] = {}
        self._taken_ticks: dict[str, int] = {}
        self._n_waypoints = 0
        self._track = messages.Track(types)
        self._track_period_ticks = max(_TRACK_PERIOD_NS // scenario.tick_ns, 1)
        self._directions = {
            sensor.name: ray_directions_body(sensor).reshape(-1, 3)
            for sensor in agent.sensors
            if isinstance(sensor, RaySensorSpec)
        }
        self.topics: dict[str, str] = {
            f"{self._root}/odom": "nav_msgs/msg/Odometry",
            f"{self._root}/pose": "geometry_msgs/msg/PoseStamped",
            f"{self._root}/track": "visualization_msgs/msg/MarkerArray",
            f"{self._root}/waypoints": "visualization_msgs/msg/Marker",
        }
        for sensor in agent.sensors:
            self.topics |= self._sensor_topics(sensor)

    def _sensor_topics(self, sensor: SensorSpec) -> dict[str, str]:
        topic = messages.topic_of(self.name, sensor.name)
        if isinstance(sensor, CameraSensorSpec):
            pictures, kind = messages.picture_topic(topic, is_depth=isinstance(sensor, DepthCameraSpec))
            return {pictures: kind, f"{topic}/camera_info": "sensor_msgs/msg/CameraInfo"}
        if isinstance(sensor, LidarSensorSpec) and sensor.model == "lidar_2d":
            return {topic: "sensor_msgs/msg/LaserScan"}
        points = {f"{topic}/points": "sensor_msgs/msg/PointCloud2"} if isinstance(sensor, RaySensorSpec) else {}
        kind = messages.find_reading_type(self._stream_names(sensor), sensor)
        return points if kind is None else {topic: kind, **points}

    # Of other packages' sensors on board nobody knows what their values are.
    def _stream_names(self, sensor: SensorSpec) -> list[str]:
        kind = find_sensor_kind(self._scenario, sensor.model)
        if kind.is_on_board and sensor.model not in ON_BOARD_STREAMS:
            return []
        made_up = Reading(sensor=sensor.name, quantity=kind.quantity, unit=kind.unit, values=(0.0, 0.0))
        return [*messages.values_by_stream(made_up, sensor.model)]

    def locate(self, time_ns: int, observation: Observation) -> Any:
        """Return where the vehicle believes that it is, as a transform."""
        position_m, turn = np.array(observation.position_world_m), quaternion_from_yaw(observation.yaw_rad)
        return self._types.transform(time_ns, MAP_FRAME, messages.base_frame(self.name), position_m, turn)

    def publish_observation(self, tick: int, time_ns: int, observation: Observation, publish: Publish) -> None:
        """Publish the pose, the track once a second, and what sensors report."""
        types = self._types
        position_m, turn = np.array(observation.position_world_m), quaternion_from_yaw(observation.yaw_rad)
        w, x, y, z = (float(value) for value in turn)
        velocity_m_s = world_from_body_rotation((w, x, y, z)).T @ np.array(observation.velocity_world_m_s)
        publish(
            f"{self._root}/odom",
            lambda: messages.make_odometry(types, time_ns, self.name, position_m, turn, velocity_m_s, np.zeros(3)),
        )
        publish(
            f"{self._root}/pose",
            lambda: types.make(
                "geometry_msgs/msg/PoseStamped",
                header=types.header(time_ns, MAP_FRAME),
                pose=types.pose(position_m, turn),
            ),
        )
        self._track.add(position_m)
        if tick % self._track_period_ticks == 0:
            publish(f"{self._root}/track", lambda: self._track.make_markers(time_ns))
        for reading in observation.readings:
            sensor = self._sensors.get(reading.sensor)
            # Estimates that are made of readings have no topic; readings are held until the next.
            if sensor is None or reading.is_warming_up:
                continue
            if isinstance(sensor, CameraSensorSpec):
                self._publish_picture(time_ns, sensor, reading, publish)
            elif tick % self._period_ticks.get(sensor.name, 1) == 0:
                self._publish_reading(time_ns, sensor, reading, publish)

    def _publish_reading(self, time_ns: int, sensor: SensorSpec, reading: Reading, publish: Publish) -> None:
        types, topic = self._types, messages.topic_of(self.name, sensor.name)
        if isinstance(sensor, RaySensorSpec):
            ranges_m = reading.array.to_array().ravel() if reading.array is not None else np.array(reading.values)
            if isinstance(sensor, LidarSensorSpec) and topic in self.topics:
                hits_m = np.where(ranges_m < sensor.max_range_m, ranges_m, np.inf).astype(np.float32)
                publish(topic, lambda: messages.make_scan(types, time_ns, self.name, sensor, hits_m, self._tick_s))
                return
            publish(f"{topic}/points", lambda: self._points(time_ns, sensor, ranges_m))
        if topic not in self.topics:
            return
        if reading.unit == "ohm":
            # In clean air, as far as the run has shown: the highest resistance.
            self._clean_air_ohm[sensor.name] = max(self._clean_air_ohm.get(sensor.name, 0.0), reading.values[0])
        clean_air_ohm = self._clean_air_ohm.get(sensor.name, 0.0)
        publish(
            topic,
            lambda: messages.make_reading(
                types,
                time_ns,
                self.name,
                sensor,
                messages.values_by_stream(reading, sensor.model),
                unit=reading.unit,
                clean_air_ohm=clean_air_ohm,
            ),
        )

    # What the rays met, in the frame of the vehicle: where that is, nobody but the truth knows.
    def _points(self, time_ns: int, sensor: RaySensorSpec, ranges_m: Any) -> Any:
        is_hit = ranges_m < sensor.max_range_m
        points_m = np.array(sensor.mount_m) + ranges_m[is_hit, None] * self._directions[sensor.name][is_hit]
        frame = messages.base_frame(self.name)
        return self._types.cloud(time_ns, points_m.astype(np.float32), ("x", "y", "z"), frame=frame)

    def _publish_picture(self, time_ns: int, sensor: CameraSensorSpec, reading: Reading, publish: Publish) -> None:
        image = reading.image
        if image is None or self._taken_ticks.get(sensor.name) == image.taken_tick:
            return
        self._taken_ticks[sensor.name] = image.taken_tick
        types, frame = self._types, messages.frame_of(self.name, sensor.name)
        topic = messages.topic_of(self.name, sensor.name)
        pictures, _ = messages.picture_topic(topic, is_depth=image.encoding == "depth_png")
        publish(pictures, lambda: messages.make_picture(types, time_ns, frame, image.encoding, image.data))
        publish(f"{topic}/camera_info", lambda: messages.calibrate_image(types, time_ns, frame, image))

    def publish_command(self, time_ns: int, command: Command, publish: Publish) -> None:
        """Publish where the vehicle is sent."""
        targets = [waypoint.position_world_m for waypoint in command.waypoints or ()]
        if command.position_world_m is not None:
            targets.append(command.position_world_m)
        for target_m in targets:
            place_m, number = np.array(target_m), self._n_waypoints
            marker = messages.make_marker(
                self._types, time_ns, "waypoints", number, place_m, messages.WAYPOINT_M, messages.BLUE
            )
            publish(f"{self._root}/waypoints", lambda marker=marker: marker, is_kept=True)
            self._n_waypoints += 1
