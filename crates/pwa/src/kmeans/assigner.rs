//! Nearest centroids for streamed rows, by the arithmetic of the fit.

use pulp::{Simd, WithSimd};

use super::{
    KMeansError,
    distance::{nearest, squared_distance},
    frame::Frame,
    screen::{Screen, TILE, Tile},
};

/// Rows that are standardised and screened together.
const BATCH: usize = 512;

/// Centroids prepared for assigning rows that arrive block by block.
///
/// The answer is that of the fit, bit for bit: the first of the centroids whose squared distance, computed in `f64`, is the least.
#[derive(Debug, Clone)]
pub struct Assigner {
    dimensions: usize,
    centroids: Vec<f64>,
    screen: Screen,
}

impl Assigner {
    /// The label of rows with a value that is not finite: they are nowhere.
    pub const NOWHERE: u32 = u32::MAX;

    /// Prepares `centroids` (k x d, row-major, standardised).
    ///
    /// # Errors
    /// No centroids, no columns, a length that is not a multiple of `dimensions`, a coordinate that is not finite or beyond 1e30.
    pub fn new(centroids: &[f64], dimensions: usize) -> Result<Self, KMeansError> {
        super::check_centroids(centroids, dimensions)?;
        Ok(Self { dimensions, centroids: centroids.to_vec(), screen: Screen::new(centroids, dimensions) })
    }

    /// Centroids, k.
    pub fn clusters(&self) -> usize {
        self.centroids.len() / self.dimensions
    }

    /// The nearest centroid of every row of a block: d slices of one length, with one centre and one scale each, `z = (value - centre) / scale`.
    ///
    /// `labels` has one place for each row; a row with a value that is not finite gets [`Assigner::NOWHERE`].
    /// `squared_distances`, if given, too (NaN for such a row). Works on the calling thread; blocks may be assigned in
    /// parallel.
    ///
    /// # Errors
    /// Slices of wrong number or length; a scale that is not positive.
    pub fn assign(
        &self,
        columns: &[&[f64]],
        centre: &[f64],
        scale: &[f64],
        labels: &mut [u32],
        mut squared_distances: Option<&mut [f64]>,
    ) -> Result<(), KMeansError> {
        let frame = Frame::new(self.dimensions, columns, centre, scale)?;
        let lengths = [Some(labels.len()), squared_distances.as_ref().map(|distances| distances.len())];
        if let Some(length) = lengths.into_iter().flatten().find(|length| *length != frame.rows) {
            return Err(KMeansError::Shape { what: "places for results", expected: frame.rows, actual: length });
        }
        let arch = fleetfoot_data::arch();
        let mut rows = vec![0.0; BATCH.min(frame.rows) * self.dimensions];
        let mut high = vec![0.0; rows.len()];
        let mut tile = Tile::new(self.dimensions);
        for from in (0..frame.rows).step_by(BATCH) {
            let range = from..(from + BATCH).min(frame.rows);
            frame.each(range.clone(), |_, _, at, z| (rows[at], high[at]) = (z, z as f32));
            let distances = squared_distances.as_deref_mut().map(|distances| &mut distances[range.clone()]);
            arch.dispatch(Batch {
                assigner: self,
                rows: &rows,
                high: &high,
                tile: &mut tile,
                labels: &mut labels[range],
                distances,
            });
        }
        Ok(())
    }
}

struct Batch<'a> {
    assigner: &'a Assigner,
    rows: &'a [f64],
    high: &'a [f32],
    tile: &'a mut Tile,
    labels: &'a mut [u32],
    distances: Option<&'a mut [f64]>,
}

impl WithSimd for Batch<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (d, centroids) = (self.assigner.dimensions, &self.assigner.centroids);
        let mut chosen = [0; TILE];
        for from in (0..self.labels.len()).step_by(TILE) {
            let count = TILE.min(self.labels.len() - from);
            for (i, chosen) in chosen.iter_mut().enumerate() {
                *chosen = (from + i) as u32;
            }
            self.assigner.screen.tile(simd, self.high, &chosen[..count], self.tile);
            for i in 0..count {
                let x = &self.rows[(from + i) * d..(from + i + 1) * d];
                let finite = x.iter().all(|x| x.is_finite());
                let label = match (finite, self.tile.doubt[i]) {
                    (false, _) => Assigner::NOWHERE,
                    (true, true) => nearest(x, centroids).label,
                    (true, false) => self.tile.label.0[i],
                };
                self.labels[from + i] = label;
                if let Some(distances) = &mut self.distances {
                    distances[from + i] =
                        if finite { squared_distance(x, &centroids[label as usize * d..][..d]) } else { f64::NAN };
                }
            }
        }
    }
}
