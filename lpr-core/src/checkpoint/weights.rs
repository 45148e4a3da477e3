//! `weights.safetensors`: the networks that act, and in the metadata what they are of.

use crate::agent::Agent;
use crate::config::Config;
use crate::digest;
use crate::error::{Error, Result};
use crate::networks::{Init, Networks};
use crate::nn::NamedTensor;
use crate::ranker::RankerState;
use crate::robot::Robot;
use crate::train::{Progress, Run, Trainer};

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// The one key of the metadata: with several, their order in the file would be random.
const METADATA: &str = "lpr";

/// The layout that this program writes, and the newest that it reads.
const VERSION: u32 = 1;

/// Header of a weights file: the run, its length and its settings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WeightsHeader {
    /// Layout of the file.
    pub version: u32,
    /// Name of the robot.
    pub robot: String,
    /// The run that was trained.
    pub run: Run,
    /// For how long.
    pub progress: Progress,
    /// Every setting.
    pub config: Config,
}

/// The first field of every version of [`WeightsHeader`].
#[derive(Deserialize)]
struct AnyVersion {
    version: u32,
}

/// An agent with its weights.
#[derive(Debug)]
pub struct SavedAgent {
    /// Header of its weights file.
    pub header: WeightsHeader,
    /// The agent, ready to act.
    pub agent: Agent,
}

/// Header of a weights file, without the weights.
///
/// # Errors
///
/// [`Error::Checkpoint`] naming what is corrupt, foreign or newer than this program.
pub fn read_header(weights: &[u8]) -> Result<WeightsHeader> {
    read(weights).map(|(header, _)| header)
}

/// The agent of a file.
///
/// # Errors
///
/// [`Error::Checkpoint`] naming what is corrupt, foreign or newer than this program, or the tensor
/// that does not fit.
pub fn load_agent(weights: &[u8]) -> Result<SavedAgent> {
    let (header, mut tensors) = read(weights)?;
    let robot = Robot::by_name(&header.robot)
        .map_err(|error| Error::Checkpoint(format!("weights: {error}")))?;
    let Run { method, poses, backend, seed, .. } = header.run;
    // Fresh weights, for their shapes: each is overwritten below, or a tensor is missing.
    let mut networks = Networks::new(
        header.config.network_settings(),
        &robot,
        method,
        poses,
        Init { backend, seed },
    )?;
    if let Some(attention) = &mut networks.q_attention {
        let mut state = attention.state();
        for (depth_idx, depth) in state.depths.iter_mut().enumerate() {
            depth.online = take(&mut tensors, &depth_name(depth_idx));
            // The file holds only the network that acts; a run that goes on gets the other from its
            // state.
            depth.target.clone_from(&depth.online);
        }
        attention.restore(&state)?;
    }
    if let Some(ranker) = &mut networks.ranker {
        let mut state = ranker.state();
        state.online = take(&mut tensors, "ranker");
        state.target.clone_from(&state.online);
        ranker.restore(&state)?;
    }
    if let Some(policy) = &mut networks.policy {
        let mut state = policy.state();
        state.network = take(&mut tensors, "policy");
        policy.restore(&state)?;
    }
    if let Some(tensor) = tensors.first() {
        return Err(Error::Checkpoint(format!(
            "weights: tensor `{}` belongs to no network",
            tensor.name
        )));
    }
    let agent = Agent::new(header.config.agent_settings(), &robot, method, networks);
    Ok(SavedAgent { header, agent })
}

/// The file of a run.
pub(super) fn write<E>(trainer: &Trainer<E>) -> Result<Vec<u8>> {
    let networks = &trainer.agent.networks;
    let mut tensors = Vec::new();
    let acting = trainer.config.training.acting_weights;
    for (depth_idx, depth) in
        networks.q_attention.iter().flat_map(|agent| agent.state().depths).enumerate()
    {
        let [acting, _] = acting.acting_first([depth.online, depth.target]);
        tensors.extend(named(&depth_name(depth_idx), acting));
    }
    if let Some(ranker) = &networks.ranker {
        let RankerState { online, target, .. } = ranker.state();
        let [acting, _] = trainer.config.ranker.acting_weights.acting_first([online, target]);
        tensors.extend(named("ranker", acting));
    }
    if let Some(policy) = &networks.policy {
        tensors.extend(named("policy", policy.state().network));
    }
    refuse_divergence(&tensors)?;
    let header = WeightsHeader {
        version: VERSION,
        robot: trainer.agent.robot().name.clone(),
        run: trainer.run.clone(),
        progress: trainer.progress,
        config: trainer.config.clone(),
    };
    let text =
        toml::to_string(&header).map_err(|error| Error::Checkpoint(format!("header: {error}")))?;
    let bytes: Vec<_> = tensors.iter().map(|tensor| (tensor, to_bytes(&tensor.values))).collect();
    let digest = content_digest(
        &text,
        bytes.iter().map(|(tensor, bytes)| (tensor.name.as_str(), bytes.as_slice())),
    );
    let metadata = HashMap::from([(METADATA.to_owned(), format!("{digest:016x}\n{text}"))]);
    let views = bytes.iter().map(|(tensor, bytes)| {
        let view = TensorView::new(Dtype::F32, tensor.shape.clone(), bytes);
        Ok((tensor.name.as_str(), view.map_err(|error| foreign(&error))?))
    });
    let views = views.collect::<Result<Vec<_>>>()?;
    safetensors::serialize(views, Some(metadata)).map_err(|error| foreign(&error))
}

/// A checkpoint of weights that are no numbers would take the place of a good one.
fn refuse_divergence(tensors: &[NamedTensor]) -> Result<()> {
    let is_sound = |tensor: &&NamedTensor| tensor.values.iter().all(|value| value.is_finite());
    match tensors.iter().find(|tensor| !is_sound(tensor)) {
        Some(tensor) => Err(Error::Checkpoint(format!(
            "weights: `{}` diverged: some of its values are not finite",
            tensor.name
        ))),
        None => Ok(()),
    }
}

fn read(weights: &[u8]) -> Result<(WeightsHeader, Vec<NamedTensor>)> {
    let file = SafeTensors::deserialize(weights).map_err(|error| foreign(&error))?;
    let (_, metadata) = SafeTensors::read_metadata(weights).map_err(|error| foreign(&error))?;
    let entry = metadata.metadata().as_ref().and_then(|entries| entries.get(METADATA));
    let missing = || {
        Error::Checkpoint(format!("weights: no metadata `{METADATA}`: not a file of this program"))
    };
    let (digest, text) = entry.and_then(|entry| entry.split_once('\n')).ok_or_else(missing)?;
    let any: AnyVersion = toml::from_str(text)
        .map_err(|error| Error::Checkpoint(format!("weights: header: {error}")))?;
    if any.version > VERSION {
        let version = any.version;
        return Err(Error::Checkpoint(format!(
            "weights: version {version}, this program reads up to {VERSION}"
        )));
    }
    let tensors = file.tensors();
    let content =
        content_digest(text, tensors.iter().map(|(name, view)| (name.as_str(), view.data())));
    if format!("{content:016x}") != digest {
        return Err(Error::Checkpoint(
            "weights: damaged: the digest does not fit the content".to_owned(),
        ));
    }
    let header = toml::from_str(text)
        .map_err(|error| Error::Checkpoint(format!("weights: header: {error}")))?;
    let tensors =
        tensors.iter().map(|(name, view)| from_view(name, view)).collect::<Result<_>>()?;
    Ok((header, tensors))
}

fn foreign(error: &safetensors::SafeTensorError) -> Error {
    Error::Checkpoint(format!("weights: not a safetensors file, or a damaged one: {error}"))
}

/// Digest of header and tensors, whatever the order of the tensors.
fn content_digest<'a>(header: &str, tensors: impl Iterator<Item = (&'a str, &'a [u8])>) -> u64 {
    let each = tensors.map(|(name, bytes)| digest::extend(digest::of(name.as_bytes()), bytes));
    each.fold(digest::of(header.as_bytes()), u64::wrapping_add)
}

/// `tensors` as those of `network`.
fn named(network: &str, tensors: Vec<NamedTensor>) -> Vec<NamedTensor> {
    let prefixed =
        |tensor: NamedTensor| NamedTensor { name: format!("{network}.{}", tensor.name), ..tensor };
    tensors.into_iter().map(prefixed).collect()
}

/// Name of the network of a depth of Q-attention.
fn depth_name(depth_idx: usize) -> String {
    format!("q_attention.{depth_idx}")
}

/// The tensors of `network`, which leave the list.
fn take(tensors: &mut Vec<NamedTensor>, network: &str) -> Vec<NamedTensor> {
    let mut taken = Vec::new();
    tensors.retain_mut(|tensor| {
        let Some(name) = tensor.name.strip_prefix(network).and_then(|rest| rest.strip_prefix('.'))
        else {
            return true;
        };
        let (name, shape, values) =
            (name.to_owned(), tensor.shape.clone(), core::mem::take(&mut tensor.values));
        taken.push(NamedTensor { name, shape, values });
        false
    });
    taken
}

fn to_bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn from_view(name: &str, view: &TensorView<'_>) -> Result<NamedTensor> {
    if view.dtype() != Dtype::F32 {
        return Err(Error::Checkpoint(format!(
            "weights: tensor `{name}`: expected F32, found {:?}",
            view.dtype()
        )));
    }
    let (words, _) = view.data().as_chunks::<4>();
    let values = words.iter().map(|word| f32::from_le_bytes(*word)).collect();
    Ok(NamedTensor { name: name.to_owned(), shape: view.shape().to_vec(), values })
}
