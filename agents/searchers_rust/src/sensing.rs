//! What a search knows when it is asked: was there gas since it was asked last, where, and whence the wind.

use std::collections::VecDeque;

use crate::common::Nose;
use crate::messages::{Briefing, Observation};

const LEAST_STEP_S: f64 = 1e-9;
const ELSEWHERE_M: f64 = 0.25;
const MOX_LAG_S: f64 = 1.0;
const LEARN_S: f64 = 2.0;
const NOISE_MEMORY_S: f64 = 20.0;
const LEAST_LEVEL: f64 = 0.1;
const FORGET_S: f64 = 300.0;

/// Returns the sum of numbers without what rounding loses on the way, as Python's `math.fsum` does (Shewchuk 1997).
pub fn exact_sum(numbers: impl IntoIterator<Item = f64>) -> f64 {
    let mut parts: Vec<f64> = Vec::new();
    for mut x in numbers {
        let mut kept = 0;
        for i in 0..parts.len() {
            let (large, small) = if x.abs() < parts[i].abs() { (parts[i], x) } else { (x, parts[i]) };
            x = large + small;
            parts[kept] = small - (x - large);
            kept += usize::from(parts[kept] != 0.0);
        }
        parts.truncate(kept);
        parts.push(x);
    }
    parts.iter().sum::<f64>() + 0.0
}

/// Returns how far two places are from each other.
pub fn distance_m(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1]).hypot(a[2] - b[2])
}

/// Tells from the slope of ln R when a MOX sensor meets gas; see `hits.OnsetDetector` of the Python package.
#[derive(Default)]
struct Onset {
    smoothing_s: f64,
    least_slope_per_s: f64,
    smooth: Option<f64>,
    last_log: f64,
    slope_per_s: f64,
    threshold_per_s: f64,
    noise_variance: f64,
    n_changes: f64,
    first_s: f64,
    last_s: f64,
}

impl Onset {
    fn new(smoothing_s: f64, least_slope_per_s: f64) -> Self {
        Self { smoothing_s, least_slope_per_s, threshold_per_s: least_slope_per_s, ..Self::default() }
    }

    fn add(&mut self, time_s: f64, ohm: f64) -> bool {
        let step_s = time_s - self.last_s;
        if ohm.is_finite() && ohm > 0.0 {
            let log_ohm = ohm.ln();
            match self.smooth {
                None => (self.smooth, self.first_s) = (Some(log_ohm), time_s),
                Some(smooth) if step_s > LEAST_STEP_S => self.follow(log_ohm, smooth, step_s),
                Some(_) => return self.is_onset(),
            }
            (self.last_s, self.last_log) = (time_s, log_ohm);
        }
        self.is_onset()
    }

    fn is_onset(&self) -> bool {
        self.last_s - self.first_s >= LEARN_S && self.slope_per_s < -self.threshold_per_s
    }

    fn is_offset(&self) -> bool {
        self.last_s - self.first_s >= LEARN_S && self.slope_per_s > self.threshold_per_s
    }

    fn follow(&mut self, log_ohm: f64, smooth: f64, step_s: f64) {
        let weight = -(-step_s / self.smoothing_s).exp_m1();
        if log_ohm != self.last_log {
            let surprise = log_ohm - self.last_log - self.slope_per_s * step_s;
            self.n_changes += 1.0;
            let share = (-(-step_s / NOISE_MEMORY_S).exp_m1()).max(1.0 / self.n_changes);
            self.noise_variance += share * (surprise * surprise / 2.0 - self.noise_variance);
        }
        self.smooth = Some(smooth + weight * (log_ohm - smooth));
        self.slope_per_s = weight * (log_ohm - smooth) / step_s;
        let sd_per_s = weight * (self.noise_variance * 2.0 / (2.0 - weight)).sqrt() / step_s;
        self.threshold_per_s = (3.0 * sd_per_s).max(self.least_slope_per_s);
    }
}

/// Tells gas, clean air and recovery apart by level and derivative; see `MoxEvidence` of the Python package.
struct MoxEvidence {
    onset: Onset,
    slow: Onset,
    baseline: Option<f64>,
    last_s: f64,
}

impl Default for MoxEvidence {
    fn default() -> Self {
        Self { onset: Onset::new(1.0, 0.005), slow: Onset::new(3.0, 0.003), baseline: None, last_s: 0.0 }
    }
}

impl MoxEvidence {
    fn add(&mut self, time_s: f64, ohm: f64) -> bool {
        self.onset.add(time_s, ohm);
        self.slow.add(time_s, ohm);
        let mut level = 0.0;
        if let Some(smooth) = self.slow.smooth {
            let above = (self.baseline.unwrap_or(smooth) - smooth).max(0.0);
            let baseline = smooth + above * (-(time_s - self.last_s) / FORGET_S).exp();
            self.baseline = Some(baseline);
            level = baseline - smooth;
        }
        self.last_s = time_s;
        let is_gas = self.onset.is_onset() || (level > LEAST_LEVEL && !self.slow.is_offset());
        is_gas && ohm.is_finite() && ohm > 0.0
    }
}

/// The first anemometer of the briefing.
#[derive(Default)]
pub struct Vane {
    name: String,
    is_3d: bool,
}

impl Vane {
    pub fn of(briefing: &Briefing) -> Result<Self, String> {
        let found = briefing.sensors.iter().find(|sensor| sensor.quantity == "apparent_wind");
        let sensor = found.ok_or("sensors: expected at least 1 of kind wind, was none")?;
        Ok(Self { name: sensor.name.clone(), is_3d: sensor.unit == "m/s" })
    }

    /// Returns the wind vector and the direction it comes from, or nothing while the sensor warms up.
    pub fn wind(&self, seen: &Observation) -> Result<Option<([f64; 2], f64)>, String> {
        let reading = seen.reading(&self.name)?;
        let [first, second, ..] = reading.values[..] else { return Err("expected two values of the wind".into()) };
        let wind = if self.is_3d {
            ([first, second], (-second).atan2(-first))
        } else {
            ([-first * second.cos(), -first * second.sin()], second)
        };
        Ok((!reading.is_warming_up).then_some(wind))
    }
}

/// What is known at a question; see `contacts.Contact` of the Python package.
pub struct Contact {
    pub has_gas: bool,
    pub gas_m: Option<[f64; 3]>,
    pub last_m: Option<[f64; 3]>,
    pub upwind_rad: Option<f64>,
}

/// Takes note of hits and wind at every observation; see `plume_contact.PlumeContactDetector` of the Python package.
#[derive(Default)]
pub struct PlumeContactDetector {
    nose: Nose,
    mox: MoxEvidence,
    threshold: f64, // of a hit, for sensors in other units
    vane: Vane,
    threshold_m_s: f64,
    lag_s: f64,
    track: VecDeque<(f64, [f64; 3])>,
    hits_m: Vec<[f64; 3]>,
    last_m: Option<[f64; 3]>,
    hold_at_m: Option<[f64; 3]>,
    winds: Vec<(f64, f64)>, // speed and upwind direction, of this hold
    upwind_rad: Option<f64>,
}

impl PlumeContactDetector {
    pub fn new(briefing: &Briefing, threshold_ppm: f64, threshold_m_s: f64) -> Result<Self, String> {
        let nose = Nose::of(briefing)?;
        Ok(Self {
            lag_s: if nose.unit == "ohm" { MOX_LAG_S } else { 0.0 },
            threshold: if nose.unit == "ppm" { threshold_ppm } else { 0.5 },
            nose,
            vane: Vane::of(briefing)?,
            threshold_m_s,
            ..Self::default()
        })
    }

    /// Takes note of an observation, once for each, and returns whether there is a hit at it.
    pub fn add(&mut self, seen: &Observation) -> Result<bool, String> {
        self.feel(seen)?;
        self.track.push_back((seen.time_s, seen.position_world_m));
        while self.track.len() > 1 && self.track[1].0 <= seen.time_s - self.lag_s {
            self.track.pop_front();
        }
        let is_hit = match self.nose.value(seen)? {
            Some(ohm) if self.nose.unit == "ohm" => self.mox.add(seen.time_s, ohm),
            value => value.is_some_and(|value| value > self.threshold),
        };
        if is_hit {
            self.last_m = Some(self.track[0].1);
            self.hits_m.push(self.track[0].1);
        }
        Ok(is_hit)
    }

    /// Returns what is known now, and begins to collect hits anew.
    pub fn contact(&mut self) -> Contact {
        self.trust_wind();
        let hits_m = std::mem::take(&mut self.hits_m);
        let mean_m = |axis: usize| exact_sum(hits_m.iter().map(|place_m| place_m[axis])) / hits_m.len() as f64;
        let has_gas = !hits_m.is_empty();
        let gas_m = has_gas.then(|| [0, 1, 2].map(mean_m));
        Contact { has_gas, gas_m, last_m: self.last_m, upwind_rad: self.upwind_rad }
    }

    /// Samples the wind of this hold; while the vehicle moves a hold has one sample.
    fn feel(&mut self, seen: &Observation) -> Result<(), String> {
        let (is_at_rest, here_m) = (seen.status == "holding" || seen.status == "on_ground", seen.position_world_m);
        let goes_on = is_at_rest && self.hold_at_m.is_some_and(|at_m| distance_m(at_m, here_m) <= ELSEWHERE_M);
        if !goes_on {
            self.winds.clear();
            self.hold_at_m = is_at_rest.then_some(here_m);
        }
        if let (Some(_), Some(([x_m_s, y_m_s], upwind_rad))) = (self.nose.value(seen)?, self.vane.wind(seen)?) {
            self.winds.push((x_m_s.hypot(y_m_s), upwind_rad));
        }
        Ok(())
    }

    /// Remembers the mean direction of this hold's wind where it was strong enough to have one.
    fn trust_wind(&mut self) {
        let n = self.winds.len() as f64;
        if exact_sum(self.winds.iter().map(|wind| wind.0)) / n > self.threshold_m_s {
            let sine = exact_sum(self.winds.iter().map(|wind| wind.1.sin())) / n;
            let cosine = exact_sum(self.winds.iter().map(|wind| wind.1.cos())) / n;
            self.upwind_rad = Some(sine.atan2(cosine));
        }
    }
}
