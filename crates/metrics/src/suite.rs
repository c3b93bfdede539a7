use std::sync::Arc;

use atsplat_pixels::Image;
use serde::Serialize;

use crate::learned::{FeatureCache, LoadError, Lpips, LpipsNetwork, WeightsAbsent, WeightsFolders};
use crate::{Definition, Measure, MetricError, NonFinite, NotComputed, Pair, Score, Values, l1, psnr, ssim};

/// Loaded networks of LPIPS and ST-LPIPS, and why others could not be loaded.
#[derive(Clone, Debug, Default)]
pub struct Networks {
    loaded: Vec<Arc<Lpips>>,
    absent: Vec<WeightsAbsent>,
}

impl Networks {
    /// Loads the networks of some metrics. Missing weights are recorded as absent.
    ///
    /// # Errors
    /// [`LoadError::File`] and [`LoadError::Mismatch`] for files that exist but are invalid.
    pub fn for_definitions(definitions: &[&Definition], folders: &WeightsFolders) -> Result<Self, LoadError> {
        let mut networks = Self::default();
        for network in definitions.iter().filter_map(|definition| definition.network()) {
            networks.load(network, folders)?;
        }
        Ok(networks)
    }

    /// Adds a loaded network, replacing one of the same kind.
    pub fn add(&mut self, lpips: Arc<Lpips>) {
        self.loaded.retain(|loaded| loaded.network() != lpips.network());
        self.absent.retain(|absent| absent.network != lpips.network());
        self.loaded.push(lpips);
    }

    /// A loaded network.
    ///
    /// # Errors
    /// [`WeightsAbsent`] with the searched folders.
    pub fn get(&self, network: LpipsNetwork) -> Result<&Arc<Lpips>, WeightsAbsent> {
        let absent = || self.absent.iter().find(|absent| absent.network == network).cloned();
        let loaded = self.loaded.iter().find(|loaded| loaded.network() == network);
        loaded.ok_or_else(|| absent().unwrap_or_else(|| WeightsAbsent::new(network, Vec::new())))
    }

    /// The networks that were loaded.
    pub fn loaded(&self) -> impl Iterator<Item = &Lpips> {
        self.loaded.iter().map(Arc::as_ref)
    }

    fn load(&mut self, network: LpipsNetwork, folders: &WeightsFolders) -> Result<(), LoadError> {
        let known = self.loaded.iter().map(|loaded| loaded.network()).chain(self.absent.iter().map(|a| a.network));
        if known.into_iter().any(|known| known == network) {
            return Ok(());
        }
        match Lpips::find(network, folders) {
            Ok(lpips) => self.loaded.push(Arc::new(lpips)),
            Err(LoadError::Absent(absent)) => self.absent.push(absent),
            Err(error) => return Err(error),
        }
        Ok(())
    }
}

/// Metrics that are computed together.
#[derive(Clone, Debug)]
pub struct Suite {
    definitions: Vec<&'static Definition>,
    networks: Networks,
    cache: Arc<FeatureCache>,
}

/// All metrics of one pair.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Scored {
    /// Number of non-finite samples; if there are any, no score is computed.
    pub non_finite: NonFinite,
    /// Whether the images are bit-identical.
    pub identical: bool,
    /// Scores by metric id, in the order of the suite's definitions.
    pub scores: Vec<(&'static str, Score)>,
}

impl Suite {
    /// A suite of metrics with the networks that some of them need, and a limit on the bytes of cached ground-truth features.
    pub fn new(definitions: Vec<&'static Definition>, networks: Networks, max_feature_bytes: usize) -> Self {
        Self { definitions, networks, cache: Arc::new(FeatureCache::new(max_feature_bytes)) }
    }

    /// The metrics, in order.
    pub fn definitions(&self) -> &[&'static Definition] {
        &self.definitions
    }

    /// The networks.
    pub const fn networks(&self) -> &Networks {
        &self.networks
    }

    /// All metrics of a pair; a metric that cannot be computed is a [`Score::NotComputed`] with the reason.
    pub fn score(&self, render: &Image, truth: &Image) -> Scored {
        let pair = Pair::new(render, truth);
        let non_finite = match &pair {
            Err(MetricError::NonFinite(counted)) => *counted,
            _ => NonFinite::default(),
        };
        let identical = pair.as_ref().is_ok_and(Pair::is_identical);
        let score = |definition: &Definition| match &pair {
            Ok(pair) => self.measure(definition, pair),
            Err(error) => Score::NotComputed(error.clone().into()),
        };
        let scores = self.definitions.iter().map(|definition| (definition.id, score(definition))).collect();
        Scored { non_finite, identical, scores }
    }

    fn measure(&self, definition: &Definition, pair: &Pair<'_>) -> Score {
        match definition.measure {
            Measure::Psnr { values } => psnr(pair, values),
            Measure::Ssim { values, ssim: convention } => ssim(pair, values, convention).into(),
            Measure::L1 { values } => Score::Value(l1(pair, values)),
            Measure::Lpips { values, network, normalize } => match self.networks.get(network) {
                Ok(lpips) => self.lpips(lpips, pair, values, normalize).into(),
                Err(absent) => Score::NotComputed(NotComputed::WeightsAbsent(absent)),
            },
        }
    }

    fn lpips(&self, lpips: &Lpips, pair: &Pair<'_>, values: Values, normalize: bool) -> Result<f64, MetricError> {
        let (render, truth) = rayon::join(
            || lpips.features(&input(pair.render(), values, normalize)),
            || self.cache.features(lpips, &input(pair.truth(), values, normalize)),
        );
        lpips.distance(&render?, &*truth?)
    }
}

/// The image for [`Lpips::features`], which scales by 2 v − 1: without `normalize`, the scaled samples are the
/// converted ones.
#[expect(clippy::expect_used, reason = "the number of samples does not change")]
fn input(image: &Image, values: Values, normalize: bool) -> Image {
    let converted = values.image(image);
    if normalize {
        return converted;
    }
    let samples = converted.samples().iter().map(|sample| sample * 0.5 + 0.5).collect();
    Image::new(image.width(), image.height(), samples).expect("as many samples as the original")
}
