//! NAME: flies half a metre up the wind, again and again. Now make it find the source.

use serde_json::{Value, json};
use std::error::Error;
use std::io::{Write, stdin, stdout};

fn main() -> Result<(), Box<dyn Error>> {
    let mut height_m = 0.0;
    for line in stdin().lines() {
        let message: Value = serde_json::from_str(&line?)?;
        if message["message"] == "Ending" {
            break;
        } else if message["message"] == "Briefing" {
            height_m = number(&message["search_height_m"]);
        } else if message["awaiting_command"] == true {
            let mut readings = message["readings"].as_array().into_iter().flatten();
            let wind = readings.find(|reading| reading["sensor"] == "wind");
            let upwind_rad = wind.map_or(0.0, |reading| number(&reading["values"][1]));
            let x_m = number(&message["position_world_m"][0]) + 0.5 * upwind_rad.cos();
            let y_m = number(&message["position_world_m"][1]) + 0.5 * upwind_rad.sin();
            let command = json!({"tick": message["tick"], "kind": "waypoint", "position_world_m": [x_m, y_m, height_m]});
            writeln!(stdout(), "{command}")?;
            stdout().flush()?;
        }
    }
    Ok(())
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_default()
}
