//! Plan of the pass: coordinates from a pilot sample, and the chunks.

use fleetfoot_data::{Canonical, Source};
use fleetfoot_library::Expr;
use fleetfoot_stats::{FINE, Grid, Preconditioner, plan_hash, scan::pilot_tiles};

use super::{
    System, SystemError,
    columns::{Columns, REGRESSION, tile_rows},
    polynomial::{Monomials, Polynomial},
    windows::WindowRows,
};

/// The first byte of coordinates: the kind of the sums in them.
const PRODUCTS: u8 = 0;
/// See [`PRODUCTS`].
const MOMENTS: u8 = 1;
/// Bytes that the statistics of a scan may take.
const BUDGET: usize = 192 << 20;

/// A frozen plan of one pass: expressions to sum, their coordinates, and the chunks. Sums of one plan can be merged,
/// whoever made them.
#[derive(Debug, Clone, PartialEq)]
pub struct SystemPlan {
    /// The system.
    pub system: System,
    /// Rows of a chunk, at most.
    pub chunk_rows: usize,
    pub(super) coordinates: Coordinates,
}

/// The coordinates in which rows are summed.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Coordinates {
    /// Functions and targets, preconditioned.
    General(Preconditioner),
    /// Chebyshev moments of the variables of a full polynomial library.
    Polynomial(Box<Polynomial>),
}

impl Coordinates {
    /// From the coordinates to raw units.
    pub(super) fn preconditioner(&self) -> &Preconditioner {
        match self {
            Self::General(preconditioner) => preconditioner,
            Self::Polynomial(polynomial) => &polynomial.preconditioner,
        }
    }

    /// Bytes of the statistic of a chunk in one region.
    fn bytes(&self) -> usize {
        let d = self.preconditioner().dimension();
        match self {
            Self::General(_) => 8 * (d + 1) * (d + 2) / 2,
            // A sum and what rounding took from it.
            Self::Polynomial(polynomial) => 16 * polynomial.plan.sums(),
        }
    }
}

impl SystemPlan {
    /// Makes a plan for a source: the coordinates come from a strided pilot sample of its rows.
    ///
    /// The scan may sum Chebyshev moments instead of products of pairs of functions. It does so under three conditions.
    /// The functions are all monomials of some variables up to a degree of two or more. There is one region. The pilot
    /// shows that it costs no significant digits.
    ///
    /// Without `chunk_rows` the chunks are as long as 192 MiB of statistics ask for, and otherwise some 200, of four rows or more.
    ///
    /// # Errors
    /// A column does not exist, the source cannot be read, or there is no target. Or the partition does not fit its
    /// columns, or there are too many episodes.
    pub fn new(system: System, chunk_rows: Option<usize>, source: &dyn Source) -> Result<Self, SystemError> {
        if let Some(plan) = Self::of_moments(&system, chunk_rows, source)? {
            return Ok(plan);
        }
        Self::of_products(system, chunk_rows, source)
    }

    /// A plan that sums Chebyshev moments, where [`SystemPlan::new`] makes one.
    ///
    /// # Errors
    /// As [`SystemPlan::new`].
    pub fn of_moments(
        system: &System,
        chunk_rows: Option<usize>,
        source: &dyn Source,
    ) -> Result<Option<Self>, SystemError> {
        system.check()?;
        let Some(polynomial) = polynomial(system, source)? else { return Ok(None) };
        Self::with(system.clone(), chunk_rows, source, Coordinates::Polynomial(Box::new(polynomial))).map(Some)
    }

    /// A plan that sums products of pairs of functions, whatever the functions are.
    ///
    /// # Errors
    /// As [`SystemPlan::new`].
    pub fn of_products(system: System, chunk_rows: Option<usize>, source: &dyn Source) -> Result<Self, SystemError> {
        system.check()?;
        let coordinates = Coordinates::General(pilot(&system, source)?);
        Self::with(system, chunk_rows, source, coordinates)
    }

    /// A plan that sums products in coordinates that a pilot has given before: those of the functions and the targets.
    ///
    /// # Errors
    /// There is no target, the partition does not fit its columns, the coordinates are of other columns, or there are too many episodes.
    pub fn in_coordinates(
        system: System,
        chunk_rows: Option<usize>,
        source: &dyn Source,
        preconditioner: Preconditioner,
    ) -> Result<Self, SystemError> {
        system.check()?;
        if (preconditioner.regressors(), preconditioner.targets()) != (system.functions.len(), system.targets.len()) {
            return Err(SystemError::Coordinates);
        }
        Self::with(system, chunk_rows, source, Coordinates::General(preconditioner))
    }

    fn with(
        system: System,
        chunk_rows: Option<usize>,
        source: &dyn Source,
        coordinates: Coordinates,
    ) -> Result<Self, SystemError> {
        let bytes = coordinates.bytes();
        Grid::check(source.episodes(), system.regions(), bytes)?;
        let default = || Grid::for_budget(source.rows(), system.regions(), bytes, BUDGET, FINE);
        // Half a window has few neighbours that it shares rows with.
        let least = system.weak.as_ref().map_or(1, |weak| weak.reach);
        let chunk_rows = chunk_rows.unwrap_or_else(|| default().max(least)).max(1);
        Ok(Self { system, chunk_rows, coordinates })
    }

    /// Text of the plan, for people and for comparison: one line a fact, without the numbers of coordinates and
    /// partition.
    pub fn text(&self) -> String {
        Self::text_of(&self.system, self.chunk_rows)
    }

    /// [`SystemPlan::text`] of a plan of this system in chunks of so many rows.
    pub fn text_of(system: &System, chunk_rows: usize) -> String {
        let partition = system.partition.as_ref();
        let of = partition.map_or_else(String::new, |partition| format!(" in {}", partition.specification));
        format!("chunk_rows of the equations{of} = {chunk_rows}\n{}", system.text())
    }

    /// Hash of the plan, the numbers of coordinates and partition included.
    pub fn hash(&self) -> String {
        let mut text = Canonical::default();
        text.text(&self.text());
        text.tag(self.system.partition.is_some().into());
        self.system.partition.iter().for_each(|partition| partition.encode_rule(&mut text));
        match &self.coordinates {
            Coordinates::General(_) => text.tag(PRODUCTS),
            Coordinates::Polynomial(polynomial) => {
                text.tag(MOMENTS);
                text.bytes(&polynomial.plan.to_bytes());
            }
        }
        plan_hash(text.as_bytes(), self.coordinates.preconditioner())
    }

    /// The coordinates as bytes: with system and chunk length they are the plan.
    pub fn coordinates(&self) -> Vec<u8> {
        match &self.coordinates {
            Coordinates::General(preconditioner) => [&[PRODUCTS][..], &preconditioner.to_bytes()].concat(),
            Coordinates::Polynomial(polynomial) => [&[MOMENTS][..], &polynomial.plan.to_bytes()].concat(),
        }
    }

    /// The plan of a system in the coordinates of [`SystemPlan::coordinates`].
    ///
    /// # Errors
    /// There is no target, the partition does not fit its columns, or the coordinates are not those of such a system.
    pub fn of_coordinates(system: System, chunk_rows: usize, coordinates: &[u8]) -> Result<Self, SystemError> {
        system.check()?;
        let coordinates = match coordinates.split_first() {
            Some((&PRODUCTS, bytes)) => {
                let preconditioner = Preconditioner::from_bytes(bytes).map_err(|_| SystemError::Coordinates)?;
                let shape = (system.functions.len(), system.targets.len());
                let fits = (preconditioner.regressors(), preconditioner.targets()) == shape;
                Coordinates::General(Some(preconditioner).filter(|_| fits).ok_or(SystemError::Coordinates)?)
            }
            Some((&MOMENTS, bytes)) if !is_partitioned(&system) && system.weak.is_none() => {
                let monomials = Monomials::recognise(&system.functions).ok_or(SystemError::Coordinates)?;
                let polynomial = monomials.restore(bytes, system.targets.len()).ok_or(SystemError::Coordinates)?;
                Coordinates::Polynomial(Box::new(polynomial))
            }
            _ => return Err(SystemError::Coordinates),
        };
        Ok(Self { system, chunk_rows, coordinates })
    }

    /// Bytes of the statistics of a chunk, at most.
    pub fn chunk_bytes(&self) -> usize {
        self.system.regions() * self.coordinates.bytes()
    }

    /// Bytes of the statistics of a scan of `rows` rows in `regions` regions, at most: those of products of pairs of
    /// functions.
    pub fn memory(system: &System, regions: usize, rows: usize) -> usize {
        let d = system.functions.len() + system.targets.len();
        let bytes = 8 * (d + 1) * (d + 2) / 2;
        let chunk_rows = Grid::for_budget(rows, regions, bytes, BUDGET, FINE);
        rows.div_ceil(chunk_rows.max(1)) * regions * bytes
    }

    /// Sums that every row adds to: the multiply-adds that it costs beside the evaluation of its columns.
    pub fn sums(&self) -> usize {
        let d = self.coordinates.preconditioner().dimension();
        match &self.coordinates {
            Coordinates::General(_) => d * (d + 1) / 2,
            Coordinates::Polynomial(polynomial) => polynomial.plan.sums(),
        }
    }

    /// Rows of a tile that are summed at once, counted from the start of a chunk: the bits of a sum depend on it.
    pub fn tile_rows(&self) -> usize {
        let System { targets, also, weight, partition, weak, .. } = &self.system;
        let partition = partition.as_ref().map_or(0, |partition| partition.columns.len());
        let rates = weak.as_ref().map_or(0, |weak| weak.expressions().1.len());
        let targets = weak.as_ref().map_or(targets.len(), |weak| weak.expressions().0.len());
        let columns =
            self.regressors().len() + targets + also.len() + partition + rates + usize::from(weight.is_some());
        tile_rows(columns, weak.as_ref())
    }

    /// Returns true if the scan sums Chebyshev moments.
    pub fn is_polynomial(&self) -> bool {
        matches!(self.coordinates, Coordinates::Polynomial(_))
    }

    /// Expressions that are evaluated on the rows in the place of the functions.
    pub(super) fn regressors(&self) -> &[Expr] {
        match &self.coordinates {
            Coordinates::General(_) => &self.system.functions,
            Coordinates::Polynomial(polynomial) => &polynomial.variables,
        }
    }
}

/// Returns true if rows must be assigned to regions.
fn is_partitioned(system: &System) -> bool {
    system.partition.as_ref().is_some_and(|partition| !partition.columns.is_empty())
}

/// The plan of moments, if the system is one for them.
fn polynomial(system: &System, source: &dyn Source) -> Result<Option<Polynomial>, SystemError> {
    if is_partitioned(system) || system.weak.is_some() {
        return Ok(None);
    }
    let Some(monomials) = Monomials::recognise(&system.functions).filter(|monomials| monomials.degree > 1) else {
        return Ok(None);
    };
    let columns = Columns::compile(system, &monomials.variables, source)?;
    Ok(monomials.plan(&sample(&columns, source)?, source.rows()))
}

/// The coordinates of functions and targets from a sample of the rows.
fn pilot(system: &System, source: &dyn Source) -> Result<Preconditioner, SystemError> {
    let columns = Columns::compile(system, &system.functions, source)?;
    Ok(Preconditioner::of_pilot(&sample(&columns, source)?, columns.regressors))
}

/// Regressors and targets of the pilot's rows, or windows, one vector a column.
fn sample(columns: &Columns, source: &dyn Source) -> Result<Vec<Vec<f64>>, SystemError> {
    let Some(weak) = &columns.weak else { return columns.rows.pilot(REGRESSION, source) };
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); columns.dimension()];
    let mut windows = WindowRows::default();
    pilot_tiles(source, columns.halo(), |episode, block, tile| {
        windows.evaluate((columns, weak), block, episode, tile)?;
        values.iter_mut().zip(windows.outputs(columns)).for_each(|(all, some)| all.extend_from_slice(some));
        Ok::<_, SystemError>(())
    })?;
    Ok(values)
}
