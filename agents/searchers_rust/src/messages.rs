//! The part of the contract that these methods use. Keys they do not know are ignored, as the contract asks.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// One line from the run.
#[derive(Deserialize)]
#[serde(tag = "message")]
pub enum Message {
    Briefing(Briefing),
    Observation(Observation),
    Ending,
}

/// What the agent is told once, before its first observation.
#[derive(Deserialize)]
pub struct Briefing {
    pub contract_version: String,
    pub seed: u64,
    pub mode: String,
    pub bounds: Bounds,
    pub search_height_m: f64,
    pub sensors: Vec<Sensor>,
    #[serde(default)]
    pub parameters: Map<String, Value>,
    pub known_map: Option<Value>,
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
    pub quantity: String,
    pub unit: String,
}

/// What the agent gets in a tick; it owes a command when `awaiting_command` is true.
#[derive(Deserialize)]
pub struct Observation {
    pub tick: u64,
    pub time_s: f64,
    pub position_world_m: [f64; 3],
    pub status: String,
    pub awaiting_command: bool,
    pub readings: Vec<Reading>,
    pub notice: Option<String>,
}

#[derive(Deserialize)]
pub struct Reading {
    pub sensor: String,
    pub values: Vec<f64>,
    #[serde(default)]
    pub is_warming_up: bool,
}

/// A leg to fly: the answer to the observation of the same tick.
#[derive(Serialize)]
pub struct Command {
    pub tick: u64,
    pub kind: &'static str,
    pub position_world_m: [f64; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hold_s: Option<f64>,
}

impl Observation {
    /// Returns the reading of a sensor.
    pub fn reading(&self, sensor: &str) -> Result<&Reading, String> {
        let found = self.readings.iter().find(|reading| reading.sensor == sensor);
        found.ok_or_else(|| format!("expected a reading of {sensor}, found none at tick {}", self.tick))
    }
}
