//! The part of the contract this agent uses. Keys it does not know are ignored, as the contract asks.

use serde::{Deserialize, Serialize};

/// How to join the run, from the environment variable `GSLCOSIM_JOIN`.
#[derive(Deserialize)]
pub struct Join {
    pub name: String,
    pub endpoint: String,
    pub namespace: String,
    pub user: String,
    pub password: String,
}

/// What the agent is told once, before its first observation.
#[derive(Deserialize)]
pub struct Briefing {
    pub contract_version: String,
    pub seed: u64,
    pub bounds: Bounds,
    pub search_height_m: f64,
    pub sensors: Vec<Sensor>,
}

/// The room, world frame.
#[derive(Deserialize)]
pub struct Bounds {
    pub min_m: [f64; 3],
    pub max_m: [f64; 3],
}

#[derive(Deserialize)]
pub struct Sensor {
    pub name: String,
    pub model: String,
    pub unit: String,
}

/// What the agent gets in a tick; it owes a command when `awaiting_command` is true.
#[derive(Deserialize)]
pub struct Observation {
    pub tick: u64,
    pub position_world_m: [f64; 3],
    pub awaiting_command: bool,
    pub readings: Vec<Reading>,
    pub notice: Option<String>,
}

#[derive(Deserialize)]
pub struct Reading {
    pub sensor: String,
    pub values: Vec<f64>,
}

/// A leg to fly: the answer to the observation of the same tick.
#[derive(Serialize)]
pub struct Waypoint {
    tick: u64,
    kind: &'static str,
    position_world_m: [f64; 3],
}

impl Waypoint {
    pub fn new(tick: u64, position_world_m: [f64; 3]) -> Self {
        Self { tick, kind: "waypoint", position_world_m }
    }
}

impl Observation {
    /// Returns one number of a sensor's reading.
    pub fn value(&self, sensor: &str, index: usize) -> Result<f64, String> {
        let reading = self.readings.iter().find(|reading| reading.sensor == sensor);
        let value = reading.and_then(|reading| reading.values.get(index));
        value
            .copied()
            .ok_or_else(|| format!("expected value {index} of sensor {sensor}, found none at tick {}", self.tick))
    }
}
