//! What all methods of this crate share: random numbers, lengths, instruments, parameters, legs.

use serde_json::{Map, Value};

use crate::messages::{Briefing, Command, Observation};

pub const N_TRIES: usize = 100;
const FULL_TURN_RAD: f64 = std::f64::consts::TAU;
const GAS_QUANTITIES: [&str; 4] = ["resistance", "mixing_ratio", "gas_detected", "hits"];

/// A search method: it sees every observation, and answers those that ask.
pub trait Method {
    fn observe(&mut self, _seen: &Observation) -> Result<(), String> {
        Ok(())
    }

    fn decide(&mut self, seen: &Observation) -> Result<Command, String>;
}

/// SplitMix64, which every language can repeat exactly.
pub struct RandomStream(pub u64);

impl RandomStream {
    /// Returns the next random number in [0, 1).
    pub fn fraction(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.fraction()
    }

    pub fn angle_rad(&mut self) -> f64 {
        FULL_TURN_RAD * self.fraction()
    }
}

/// Rounds to whole millimetres, so that the last bit of sin and cos has no effect.
pub fn to_millimetre(length_m: f64) -> f64 {
    (length_m * 1000.0 + 0.5).floor() / 1000.0
}

/// The settings of the briefing; one that a method does not know is refused.
pub struct Parameters<'a>(&'a Map<String, Value>);

impl<'a> Parameters<'a> {
    pub fn of(briefing: &'a Briefing, known: &[&str]) -> Result<Self, String> {
        match briefing.parameters.keys().find(|name| !known.contains(&name.as_str())) {
            Some(name) => Err(format!("parameters.{name}: this method in Rust has no such parameter")),
            None => Ok(Self(&briefing.parameters)),
        }
    }

    pub fn number(&self, name: &str, usual: f64) -> Result<f64, String> {
        Ok(self.number_if_given(name)?.unwrap_or(usual))
    }

    pub fn whole(&self, name: &str, usual: usize) -> Result<usize, String> {
        let wrong = |value: &Value| format!("parameters.{name}: expected a whole number, was {value}");
        let given = self.0.get(name).map(|value| value.as_u64().ok_or_else(|| wrong(value))).transpose()?;
        Ok(given.map_or(usual, |number| number as usize))
    }

    /// Returns one of several words, the first where none is given.
    pub fn choice<'b>(&self, name: &str, choices: &[&'b str]) -> Result<&'b str, String> {
        let Some(value) = self.0.get(name) else { return Ok(choices[0]) };
        let found = choices.iter().find(|choice| value == **choice);
        found.copied().ok_or_else(|| format!("parameters.{name}: expected one of {}, was {value}", choices.join(", ")))
    }

    /// Returns nothing where it is not given, or null.
    pub fn number_if_given(&self, name: &str) -> Result<Option<f64>, String> {
        let wrong = |value: &Value| format!("parameters.{name}: expected a number, was {value}");
        let given = self.0.get(name).filter(|value| !value.is_null());
        given.map(|value| value.as_f64().ok_or_else(|| wrong(value))).transpose()
    }

    /// Refuses a scenario in which the Python method would declare the source.
    pub fn require_no_declarations(&self) -> Result<(), String> {
        let wrong = "parameters.declares: expected false, because this method in Rust never declares".to_string();
        if self.0.get("declares") == Some(&Value::Bool(false)) { Ok(()) } else { Err(wrong) }
    }

    /// Refuses all but one of the ways in which the Python method can do something.
    pub fn require(&self, name: &str, only: Value) -> Result<(), String> {
        match self.0.get(name) {
            Some(value) if *value != only => Err(format!("parameters.{name}: expected {only}, was {value}")),
            _ => Ok(()),
        }
    }
}

/// The room without its margin; where there is less than two margins, its middle.
pub struct Room {
    pub min_m: [f64; 2],
    pub max_m: [f64; 2],
}

impl Room {
    pub fn of(briefing: &Briefing, margin_m: f64) -> Self {
        let (low_m, high_m) = (briefing.bounds.min_m, briefing.bounds.max_m);
        let middle_m = |axis: usize| (low_m[axis] + high_m[axis]) / 2.0;
        Self {
            min_m: [0, 1].map(|axis| (low_m[axis] + margin_m).min(middle_m(axis))),
            max_m: [0, 1].map(|axis| (high_m[axis] - margin_m).max(middle_m(axis))),
        }
    }

    pub fn contains(&self, point_m: [f64; 2]) -> bool {
        (0..2).all(|axis| self.min_m[axis] <= point_m[axis] && point_m[axis] <= self.max_m[axis])
    }

    /// Returns the nearest place inside.
    pub fn nearest(&self, point_m: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| to_millimetre(point_m[axis].min(self.max_m[axis]).max(self.min_m[axis])))
    }

    /// Returns the end of a leg, or nothing where it would come too close to a wall.
    pub fn leg_end(&self, [x_m, y_m]: [f64; 2], heading_rad: f64, length_m: f64) -> Option<[f64; 2]> {
        let end_m = [x_m + length_m * heading_rad.cos(), y_m + length_m * heading_rad.sin()].map(to_millimetre);
        self.contains(end_m).then_some(end_m)
    }
}

/// The first gas sensor of the briefing.
#[derive(Default)]
pub struct Nose {
    name: String,
    pub unit: String,
}

impl Nose {
    pub fn of(briefing: &Briefing) -> Result<Self, String> {
        let found = briefing.sensors.iter().find(|sensor| GAS_QUANTITIES.contains(&sensor.quantity.as_str()));
        let sensor = found.ok_or("sensors: expected at least 1 of kind gas, was none")?;
        Ok(Self { name: sensor.name.clone(), unit: sensor.unit.clone() })
    }

    /// Returns the reading as it is, or nothing while the sensor warms up.
    pub fn value(&self, seen: &Observation) -> Result<Option<f64>, String> {
        let reading = seen.reading(&self.name)?;
        let value = *reading.values.first().ok_or("expected a value of the gas sensor, found none")?;
        Ok((!reading.is_warming_up).then_some(value))
    }

    /// Returns a number that grows with the gas, or nothing while the sensor warms up.
    pub fn amount(&self, seen: &Observation) -> Result<Option<f64>, String> {
        let amount = |value: f64| match (self.unit == "ohm", value > 0.0) {
            (false, _) => value,
            (true, true) => 1.0 / value,
            (true, false) => f64::INFINITY,
        };
        Ok(self.value(seen)?.map(amount))
    }
}

pub fn place_of(seen: &Observation) -> [f64; 2] {
    [seen.position_world_m[0], seen.position_world_m[1]]
}

pub fn waypoint(seen: &Observation, [x_m, y_m]: [f64; 2], height_m: f64, hold_s: Option<f64>) -> Command {
    Command { tick: seen.tick, kind: "waypoint", position_world_m: [x_m, y_m, height_m], hold_s }
}
