//! Surge-cast: upwind while there is gas; across the wind when it is lost. The rules are those of `agents/surge_cast`.

use std::f64::consts::FRAC_PI_2;

use crate::common::{Method, Parameters, place_of};
use crate::messages::{Briefing, Command, Observation};
use crate::piloting::{Leash, Pilot};
use crate::sensing::{Contact, PlumeContactDetector, distance_m, exact_sum};
use crate::unseen::UnseenSquares;

const WANDER_M: f64 = 0.5;
const LEAST_LEG_M: f64 = 0.1;
#[rustfmt::skip]
const KNOWN: [&str; 22] = [
    "step_m", "lost_by", "lost_m", "memory_s", "least_memory_s", "most_memory_s", "cast_m", "growth", "n_casts",
    "n_returns", "explore", "aborts_legs", "margin_m", "hold_s", "explore_hold_s", "explore_step_m", "threshold_ppm",
    "threshold_m_s", "leash_legs", "leash_m", "leash_away_legs", "declares",
];

/// A flight across the wind, one way and then farther the other, from where a plume was lost.
struct Cast {
    anchor_m: [f64; 2],
    across: [f64; 2],
    n_done: usize,
}

/// Remembers where gas was met last, the wind there, and how far a cast has come.
pub struct SurgeCast {
    step_m: f64,
    is_lost_by_distance: bool,
    lost_m: f64,
    cast_m: f64,
    growth: &'static str,
    n_casts: usize,
    n_returns: usize,
    explores_unseen: bool,
    hold_s: Option<f64>,
    explore_hold_s: f64,
    n_leash_away: usize,
    pilot: Pilot,
    watch: PlumeContactDetector,
    unseen: UnseenSquares,
    leash: Leash,
    least_memory_s: f64,
    most_memory_s: f64,
    memory_s: f64,
    last_hit_s: Option<f64>,
    upwind_rad: f64, // that of the surge
    is_surging: bool,
    cast: Option<Cast>,
    n_returns_left: usize,
    n_away: usize,
    goal_m: Option<[f64; 2]>,
}

impl SurgeCast {
    pub fn new(briefing: &Briefing) -> Result<Self, String> {
        let settings = Parameters::of(briefing, &KNOWN)?;
        settings.require_no_declarations()?;
        if briefing.mode != "on_request" || briefing.known_map.is_some() {
            return Err("surge_cast in Rust flies on request and without a map only".to_string());
        }
        let number = |name: &str, usual: f64| settings.number(name, usual);
        let pilot = Pilot::new(briefing, number("margin_m", 0.5)?);
        let (least_memory_s, most_memory_s) = (number("least_memory_s", 1.0)?, number("most_memory_s", 20.0)?);
        Ok(Self {
            step_m: number("step_m", 1.0)?,
            is_lost_by_distance: settings.choice("lost_by", &["distance", "last_blank"])? == "distance",
            lost_m: number("lost_m", 2.0)?,
            cast_m: number("cast_m", 0.75)?,
            growth: settings.choice("growth", &["growing", "fixed", "doubling"])?,
            n_casts: settings.whole("n_casts", 4)?,
            n_returns: settings.whole("n_returns", 1)?,
            explores_unseen: settings.choice("explore", &["unseen", "random"])? == "unseen",
            hold_s: settings.number_if_given("hold_s")?,
            explore_hold_s: number("explore_hold_s", 0.0)?,
            n_leash_away: settings.whole("leash_away_legs", 6)?,
            watch: PlumeContactDetector::new(briefing, number("threshold_ppm", 0.1)?, number("threshold_m_s", 0.1)?)?,
            unseen: UnseenSquares::new(&pilot.room, number("explore_step_m", 1.8)?),
            leash: Leash::new(settings.whole("leash_legs", 20)?, number("leash_m", 2.0)?),
            memory_s: number("memory_s", 5.0)?.max(least_memory_s).min(most_memory_s),
            least_memory_s,
            most_memory_s,
            last_hit_s: None,
            pilot,
            upwind_rad: 0.0,
            is_surging: false,
            cast: None,
            n_returns_left: 0,
            n_away: 0,
            goal_m: None,
        })
    }

    fn cast_or_explore(&mut self, seen: &Observation, contact: &Contact) -> Command {
        while let Some(mut cast) = self.cast.take() {
            while let Some(place_m) = self.next_turn_m(&mut cast) {
                if self.pilot.is_worth_it(seen, place_m) {
                    self.cast = Some(cast);
                    return self.fly_to(seen, place_m, Some(self.explore_hold_s));
                }
            }
            if let Some(last_m) = contact.last_m.filter(|_| self.n_returns_left > 0) {
                self.n_returns_left -= 1;
                self.cast = Some(self.new_cast([last_m[0], last_m[1]], contact));
            }
        }
        self.explore(seen, contact)
    }

    fn is_lost(&self, seen: &Observation, contact: &Contact) -> bool {
        let is_far = self.way_left_m(seen, contact) <= LEAST_LEG_M;
        let is_late = self.last_hit_s.is_none_or(|last_s| seen.time_s - last_s > self.memory_s);
        !contact.has_gas && if self.is_lost_by_distance { is_far } else { is_late }
    }

    /// Returns how far to fly on without gas before the plume counts as lost.
    fn way_left_m(&self, seen: &Observation, contact: &Contact) -> f64 {
        let left_m = |last_m| self.lost_m - distance_m(last_m, seen.position_world_m);
        if contact.has_gas { f64::INFINITY } else { contact.last_m.map_or(f64::NEG_INFINITY, left_m) }
    }

    /// Returns a leg upwind, in line with the gas of the last leg.
    fn surge(&mut self, seen: &Observation, contact: &Contact) -> Command {
        let [x_m, y_m] = place_of(seen);
        let left_m = if self.is_lost_by_distance { self.way_left_m(seen, contact) } else { f64::INFINITY };
        let step_m = self.step_m.min(left_m);
        let (along_y, along_x) = self.upwind_rad.sin_cos();
        let across_m = contact.gas_m.map_or(0.0, |gas_m| (gas_m[1] - y_m) * along_x - (gas_m[0] - x_m) * along_y);
        let place_m = [x_m + step_m * along_x - across_m * along_y, y_m + step_m * along_y + across_m * along_x];
        self.fly_to(seen, place_m, self.hold_s)
    }

    /// Returns a cast that begins on the side on which gas was met last, else on a random one.
    fn new_cast(&mut self, here_m: [f64; 2], contact: &Contact) -> Cast {
        let last_m = contact.last_m.map_or(here_m, |last_m| [last_m[0], last_m[1]]);
        let (dx_m, dy_m) = (last_m[0] - here_m[0], last_m[1] - here_m[1]);
        let cross_m = self.upwind_rad.cos() * dy_m - self.upwind_rad.sin() * dx_m;
        let is_left = if cross_m.abs() <= 0.001 { self.pilot.draws.fraction() < 0.5 } else { cross_m > 0.0 };
        let across_rad = self.upwind_rad + if is_left { FRAC_PI_2 } else { -FRAC_PI_2 };
        Cast { anchor_m: here_m, across: [across_rad.cos(), across_rad.sin()], n_done: 0 }
    }

    /// Returns the end of the next leg of a cast, or nothing when it is over.
    fn next_turn_m(&self, cast: &mut Cast) -> Option<[f64; 2]> {
        if cast.n_done >= self.n_casts {
            return None;
        }
        let length_m = |n: usize| match self.growth {
            "doubling" => self.cast_m * 2f64.powi(n as i32),
            "fixed" => self.cast_m * (n.min(1) + 1) as f64,
            _ => self.cast_m * (n + 1) as f64,
        };
        let signed_m = |n: usize| if n % 2 == 0 { length_m(n) } else { -length_m(n) };
        let offset_m = exact_sum((0..=cast.n_done).map(signed_m));
        cast.n_done += 1;
        Some([0, 1].map(|axis| cast.anchor_m[axis] + offset_m * cast.across[axis]))
    }

    /// Returns a leg without gas: to a place not seen yet, or at random nearby.
    fn explore(&mut self, seen: &Observation, contact: &Contact) -> Command {
        let here_m = place_of(seen);
        if !self.explores_unseen && self.n_away == 0 {
            let place_m = here_m.map(|x_m| x_m + self.pilot.draws.uniform(-WANDER_M, WANDER_M));
            return self.fly_to(seen, place_m, Some(self.explore_hold_s));
        }
        self.n_away = self.n_away.saturating_sub(1);
        if let Some(goal_m) = self.goal_m.filter(|_| self.pilot.was_refused(seen)) {
            self.unseen.note(goal_m, false);
        }
        let goal_m = self.unseen.next_place_m(here_m, contact.upwind_rad);
        let command = self.fly_to(seen, goal_m, Some(self.explore_hold_s));
        self.goal_m = Some(goal_m);
        command
    }

    fn fly_to(&mut self, seen: &Observation, place_m: [f64; 2], hold_s: Option<f64>) -> Command {
        self.goal_m = None;
        self.pilot.leg(seen, place_m, hold_s)
    }
}

impl Method for SurgeCast {
    fn observe(&mut self, seen: &Observation) -> Result<(), String> {
        if self.watch.add(seen)? {
            let blank_s = self.last_hit_s.replace(seen.time_s).map_or(0.0, |last_s| seen.time_s - last_s);
            if blank_s > 0.0 {
                self.memory_s = blank_s.max(self.least_memory_s).min(self.most_memory_s);
            }
        }
        self.unseen.note(place_of(seen), true);
        Ok(())
    }

    fn decide(&mut self, seen: &Observation) -> Result<Command, String> {
        let contact = self.watch.contact();
        if self.leash.pulls(place_of(seen)) {
            self.n_away = self.n_leash_away;
        }
        let Some(upwind_rad) = contact.upwind_rad.filter(|_| self.n_away == 0) else {
            (self.is_surging, self.cast) = (false, None);
            return Ok(self.explore(seen, &contact));
        };
        if contact.has_gas {
            (self.is_surging, self.cast, self.upwind_rad) = (true, None, upwind_rad);
        }
        if self.is_surging && !self.is_lost(seen, &contact) {
            return Ok(self.surge(seen, &contact));
        }
        if self.is_surging {
            (self.is_surging, self.n_returns_left) = (false, self.n_returns);
            self.cast = Some(self.new_cast(place_of(seen), &contact));
        }
        Ok(self.cast_or_explore(seen, &contact))
    }
}
