//! E. coli: on with more gas, otherwise anywhere. The rules and the arithmetic are those of `agents/e_coli/README.md`.

use serde_json::json;

use crate::common::{Method, N_TRIES, Nose, Parameters, RandomStream, Room, place_of, waypoint};
use crate::messages::{Briefing, Command, Observation};

/// Remembers the gas of its last stop and its last heading.
pub struct EColi {
    step_m: f64,
    eps: f64,
    hold_s: Option<f64>,
    nose: Nose,
    room: Room,
    height_m: f64,
    draws: RandomStream,
    before: Option<f64>,
    heading_rad: Option<f64>,
}

impl EColi {
    pub fn new(briefing: &Briefing) -> Result<Self, String> {
        let known = ["step_m", "eps", "wall_margin_m", "hold_s", "measure", "declares"];
        let settings = Parameters::of(briefing, &known)?;
        settings.require("measure", json!("last"))?;
        settings.require_no_declarations()?;
        Ok(Self {
            step_m: settings.number("step_m", 1.0)?,
            eps: settings.number("eps", 0.005)?,
            hold_s: settings.number_if_given("hold_s")?,
            nose: Nose::of(briefing)?,
            room: Room::of(briefing, settings.number("wall_margin_m", 0.5)?),
            height_m: briefing.search_height_m,
            draws: RandomStream(briefing.seed),
            before: None,
            heading_rad: None,
        })
    }

    fn has_more(&mut self, seen: &Observation) -> Result<bool, String> {
        let Some(amount) = self.nose.amount(seen)? else { return Ok(false) };
        let before = self.before.replace(amount);
        Ok(before.is_some_and(|before| (1.0 - self.eps) * amount > before.max(0.0)))
    }

    /// Returns the end of the next leg; one that may not be flown draws another heading, also where it was kept.
    fn next_end_m(&mut self, start_m: [f64; 2], keeps: bool) -> [f64; 2] {
        let kept = self.heading_rad.filter(|_| keeps);
        if let Some(end_m) = kept.and_then(|heading_rad| self.room.leg_end(start_m, heading_rad, self.step_m)) {
            return end_m;
        }
        for _ in 0..N_TRIES {
            let heading_rad = self.draws.angle_rad();
            self.heading_rad = Some(heading_rad);
            if let Some(end_m) = self.room.leg_end(start_m, heading_rad, self.step_m) {
                return end_m;
            }
        }
        self.heading_rad = None;
        self.room.nearest(start_m)
    }
}

impl Method for EColi {
    fn decide(&mut self, seen: &Observation) -> Result<Command, String> {
        let keeps = self.has_more(seen)? && seen.notice.is_none();
        let end_m = self.next_end_m(place_of(seen), keeps);
        Ok(waypoint(seen, end_m, self.height_m, self.hold_s))
    }
}
