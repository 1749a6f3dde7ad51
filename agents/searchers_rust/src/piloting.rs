//! From a place where a search wants to go to a leg that can be flown; a leash against eddies.

use std::collections::VecDeque;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use crate::common::{N_TRIES, RandomStream, Room, place_of, to_millimetre, waypoint};
use crate::messages::{Briefing, Command, Observation};
use crate::sensing::exact_sum;

const SAME_END_M: f64 = 0.02;
const LEAST_LEG_M: f64 = 0.1;
const SHORTEN_M: f64 = 0.05;
const N_SHORTEN: usize = 10;

/// Flies legs to places, and never a refused leg again as it was; see `piloting.Pilot` of the Python package.
pub struct Pilot {
    pub room: Room,
    pub draws: RandomStream,
    height_m: f64,
    end_m: Option<[f64; 2]>,
}

impl Pilot {
    pub fn new(briefing: &Briefing, margin_m: f64) -> Self {
        let (room, draws) = (Room::of(briefing, margin_m), RandomStream(briefing.seed));
        Self { room, draws, height_m: briefing.search_height_m, end_m: None }
    }

    /// Returns whether the vehicle tells that it did not do as it was asked.
    pub fn was_refused(&self, seen: &Observation) -> bool {
        seen.notice.is_some() && self.end_m.is_some()
    }

    /// Returns whether a leg towards a place leads anywhere before it meets the margin of the room.
    pub fn is_worth_it(&self, seen: &Observation, target_m: [f64; 2]) -> bool {
        let start_m = place_of(seen);
        length_m(start_m, self.cut_end_m(start_m, target_m)) >= LEAST_LEG_M
    }

    /// Returns the command for a leg to a place, or as near to it as can be flown.
    pub fn leg(&mut self, seen: &Observation, target_m: [f64; 2], hold_s: Option<f64>) -> Command {
        let refused_m = if self.was_refused(seen) { self.end_m } else { None };
        let end_m = self.end_of_leg_m(place_of(seen), target_m, refused_m);
        self.end_m = Some(end_m);
        waypoint(seen, end_m, self.height_m, hold_s)
    }

    fn end_of_leg_m(&mut self, start_m: [f64; 2], target_m: [f64; 2], refused_m: Option<[f64; 2]>) -> [f64; 2] {
        let wanted_m = length_m(start_m, target_m);
        if wanted_m < SAME_END_M && refused_m.is_none() {
            return start_m.map(to_millimetre);
        }
        let is_new = |end_m: &[f64; 2]| refused_m.is_none_or(|refused_m| length_m(*end_m, refused_m) >= SAME_END_M);
        if let Some(end_m) = self.shortened_end_m(start_m, target_m).filter(is_new) {
            return end_m;
        }
        let towards_rad = (target_m[1] - start_m[1]).atan2(target_m[0] - start_m[0]);
        let around = [FRAC_PI_4, -FRAC_PI_4, FRAC_PI_2, -FRAC_PI_2].map(|turn_rad| towards_rad + turn_rad);
        let random = std::iter::repeat_with(|| self.draws.angle_rad()).take(N_TRIES);
        let mut ends_m =
            around.into_iter().chain(random).filter_map(|heading| self.room.leg_end(start_m, heading, wanted_m));
        ends_m.find(is_new).unwrap_or_else(|| self.room.nearest(start_m))
    }

    fn shortened_end_m(&self, start_m: [f64; 2], target_m: [f64; 2]) -> Option<[f64; 2]> {
        let aim_m = self.cut_end_m(start_m, target_m);
        let (dx_m, dy_m) = (aim_m[0] - start_m[0], aim_m[1] - start_m[1]);
        let (full_m, heading_rad) = (dx_m.hypot(dy_m), dy_m.atan2(dx_m));
        let lengths_m = (0..=N_SHORTEN).map(|i| full_m - i as f64 * SHORTEN_M).take_while(|length_m| *length_m > 0.0);
        lengths_m.map(|length_m| self.room.leg_end(start_m, heading_rad, length_m)).find_map(|end_m| end_m)
    }

    /// Returns the last place on the straight way to a target that lies inside the room's margin.
    fn cut_end_m(&self, start_m: [f64; 2], target_m: [f64; 2]) -> [f64; 2] {
        let mut t: f64 = 1.0;
        for axis in 0..2 {
            let (start, target) = (start_m[axis], target_m[axis]);
            let (low, high) = (self.room.min_m[axis], self.room.max_m[axis]);
            if !(low <= start && start <= high) {
                return self.room.nearest(target_m);
            }
            if target > high {
                t = t.min((high - start) / (target - start));
            } else if target < low {
                t = t.min((low - start) / (target - start));
            }
        }
        [0, 1].map(|axis| start_m[axis] + t * (target_m[axis] - start_m[axis]))
    }
}

/// The places of the last legs; it is wound up when all of them lie close together.
pub struct Leash {
    n_legs: usize,
    radius_m: f64,
    places_m: VecDeque<[f64; 2]>,
}

impl Leash {
    /// Begins without places; 0 legs switch it off.
    pub fn new(n_legs: usize, radius_m: f64) -> Self {
        Self { n_legs, radius_m, places_m: VecDeque::new() }
    }

    /// Takes note of where a leg has ended; returns whether it is wound up, and lets go if so.
    pub fn pulls(&mut self, place_m: [f64; 2]) -> bool {
        self.places_m.push_front(place_m);
        self.places_m.truncate(self.n_legs);
        if self.n_legs == 0 || self.places_m.len() < self.n_legs {
            return false;
        }
        let mean_m = [0, 1].map(|axis| exact_sum(self.places_m.iter().map(|p| p[axis])) / self.n_legs as f64);
        let is_wound_up = self.places_m.iter().all(|place_m| length_m(*place_m, mean_m) <= self.radius_m);
        if is_wound_up {
            self.places_m.clear();
        }
        is_wound_up
    }
}

fn length_m(start_m: [f64; 2], end_m: [f64; 2]) -> f64 {
    (end_m[0] - start_m[0]).hypot(end_m[1] - start_m[1])
}
