//! A search for first contact: squares of the floor that the vehicle has not been to, the nearest across the wind first.

use crate::common::Room;

const ALONG_WEIGHT: f64 = 2.0;

/// Which squares of a room were not visited; see `unseen.UnseenSquares` of the Python package.
pub struct UnseenSquares {
    columns_m: Vec<f64>,
    rows_m: Vec<f64>,
    radius_m: f64,
    is_seen: Vec<bool>, // column by column
}

impl UnseenSquares {
    pub fn new(room: &Room, edge_m: f64) -> Self {
        let [columns_m, rows_m] = [0, 1].map(|axis| middles_m(room.min_m[axis], room.max_m[axis], edge_m));
        let is_seen = vec![false; columns_m.len() * rows_m.len()];
        Self { columns_m, rows_m, radius_m: edge_m / 2.0, is_seen }
    }

    /// Takes the square around a place for seen: where the vehicle is, or one that it cannot reach, whatever the radius.
    pub fn note(&mut self, [x_m, y_m]: [f64; 2], is_there: bool) {
        let (i, j) = (nearest(&self.columns_m, x_m), nearest(&self.rows_m, y_m));
        let is_near = (self.columns_m[i] - x_m).hypot(self.rows_m[j] - y_m) < self.radius_m;
        self.is_seen[i * self.rows_m.len() + j] |= is_near || !is_there;
    }

    /// Returns the centre of the next square to visit.
    pub fn next_place_m(&mut self, here_m: [f64; 2], upwind_rad: Option<f64>) -> [f64; 2] {
        if self.is_seen.iter().all(|is_seen| *is_seen) {
            self.is_seen.fill(false);
        }
        let (along_y, along_x) = upwind_rad.unwrap_or(0.0).sin_cos();
        let (mut best_m, mut best_m2) = ([self.columns_m[0], self.rows_m[0]], f64::INFINITY);
        for k in (0..self.is_seen.len()).filter(|k| !self.is_seen[*k]) {
            let place_m = [self.columns_m[k / self.rows_m.len()], self.rows_m[k % self.rows_m.len()]];
            let (dx_m, dy_m) = (place_m[0] - here_m[0], place_m[1] - here_m[1]);
            let along_m = ALONG_WEIGHT * (dx_m * along_x + dy_m * along_y);
            let across_m = dy_m * along_x - dx_m * along_y;
            let distance_m2 = across_m * across_m + along_m * along_m;
            // A micrometre decides nothing: the last bit of a sine does not choose the way.
            if distance_m2 < best_m2 - 1e-6 {
                (best_m, best_m2) = (place_m, distance_m2);
            }
        }
        best_m
    }
}

fn middles_m(low_m: f64, high_m: f64, edge_m: f64) -> Vec<f64> {
    let n = ((high_m - low_m) / edge_m - 1e-9).ceil().max(1.0);
    (0..n as usize).map(|i| low_m + (high_m - low_m) * (i as f64 + 0.5) / n).collect()
}

fn nearest(places_m: &[f64], place_m: f64) -> usize {
    let is_nearer = |best: usize, i: usize| (places_m[i] - place_m).abs() < (places_m[best] - place_m).abs();
    (1..places_m.len()).fold(0, |best, i| if is_nearer(best, i) { i } else { best })
}
