//! The search itself; the rules and the exact arithmetic are those of `agents/dung_beetle/README.md`.

use crate::messages::{Briefing, Observation, Waypoint};

const LEG_M: f64 = 0.8;
const WALL_MARGIN_M: f64 = 1.0;
const RIGHT_ANGLE_RAD: f64 = std::f64::consts::FRAC_PI_2;
const ZIGZAG_RAD: f64 = 1.0471975511965976; // 60 degrees; the double nearest to a third of pi is another one
const HALF_TURN_RAD: f64 = std::f64::consts::PI;
const FULL_TURN_RAD: f64 = std::f64::consts::TAU;
const N_RANDOM_HEADINGS: usize = 100;

/// Seeks gas across the wind, then zigzags up the wind; all it remembers is one reading and its side.
pub struct DungBeetle {
    nose: String,
    vane: String,
    min_m: [f64; 2],
    max_m: [f64; 2],
    height_m: f64,
    random: SplitMix64,
    last_ohm: Option<f64>,
    side: i8, // 0 seeking, +1 zigzagging left of upwind, -1 right of it
}

impl DungBeetle {
    pub fn new(briefing: &Briefing) -> Result<Self, String> {
        if !briefing.contract_version.starts_with("1.") {
            return Err(format!("expected contract version 1, was {}", briefing.contract_version));
        }
        let nose = briefing.sensors.iter().find(|sensor| sensor.unit == "ohm");
        let vane = briefing.sensors.iter().find(|sensor| sensor.model == "anemometer");
        Ok(Self {
            nose: nose.ok_or("expected a sensor in ohm, found none")?.name.clone(),
            vane: vane.ok_or("expected an anemometer, found none")?.name.clone(),
            min_m: [0, 1].map(|axis| briefing.bounds.min_m[axis] + WALL_MARGIN_M),
            max_m: [0, 1].map(|axis| briefing.bounds.max_m[axis] - WALL_MARGIN_M),
            height_m: briefing.search_height_m,
            random: SplitMix64(briefing.seed),
            last_ohm: None,
            side: 0,
        })
    }

    /// Returns the next leg.
    pub fn decide(&mut self, seen: &Observation) -> Result<Waypoint, String> {
        let ohm = seen.value(&self.nose, 0)?;
        let upwind_rad = seen.value(&self.vane, 1)?;
        let has_more_gas = self.last_ohm.is_some_and(|last| ohm < last);
        self.last_ohm = Some(ohm);
        self.side = match self.side {
            0 => i8::from(has_more_gas),
            side if has_more_gas => side,
            side => -side,
        };
        let [x_m, y_m] = self.next_waypoint(seen, upwind_rad);
        Ok(Waypoint::new(seen.tick, [x_m, y_m, self.height_m]))
    }

    /// Returns the end of the first leg that keeps away from the walls; without one, leaves the margin.
    fn next_waypoint(&mut self, seen: &Observation, upwind_rad: f64) -> [f64; 2] {
        let [x_m, y_m, _] = seen.position_world_m;
        for (side, heading_rad) in self.headings_of_rule(upwind_rad, seen.notice.is_some()) {
            self.side = side;
            if let Some(goal) = self.leg([x_m, y_m], heading_rad) {
                return goal;
            }
        }
        for _ in 0..N_RANDOM_HEADINGS {
            let heading_rad = FULL_TURN_RAD * self.random.next_fraction();
            if let Some(goal) = self.leg([x_m, y_m], heading_rad) {
                return goal;
            }
        }
        [(x_m, 0), (y_m, 1)].map(|(at_m, axis)| to_millimetre(at_m.min(self.max_m[axis]).max(self.min_m[axis])))
    }

    /// Returns the headings to try before random ones, each with the side it is flown on.
    fn headings_of_rule(&self, upwind_rad: f64, is_blocked: bool) -> Vec<(i8, f64)> {
        match self.side {
            0 if is_blocked => vec![],
            0 => vec![(0, upwind_rad + RIGHT_ANGLE_RAD)],
            side => vec![
                (side, upwind_rad + f64::from(side) * ZIGZAG_RAD),
                (-side, upwind_rad + f64::from(-side) * ZIGZAG_RAD),
                (-side, upwind_rad + HALF_TURN_RAD),
            ],
        }
    }

    fn leg(&self, [x_m, y_m]: [f64; 2], heading_rad: f64) -> Option<[f64; 2]> {
        let goal = [x_m + LEG_M * heading_rad.cos(), y_m + LEG_M * heading_rad.sin()].map(to_millimetre);
        let fits = (0..2).all(|axis| self.min_m[axis] <= goal[axis] && goal[axis] <= self.max_m[axis]);
        fits.then_some(goal)
    }
}

/// A random number generator that every language can repeat exactly.
struct SplitMix64(u64);

impl SplitMix64 {
    /// Returns the next random number in [0, 1).
    fn next_fraction(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Rounds to whole millimetres, so that the last bit of sin and cos has no effect.
fn to_millimetre(length_m: f64) -> f64 {
    (length_m * 1000.0 + 0.5).floor() / 1000.0
}
