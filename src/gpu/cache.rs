//! The driver's compiled pipelines, kept in a file between runs.
//!
//! File: `LSPIPES1`, FNV-1a of the data (u64, little endian), the data of vkGetPipelineCacheData. Drivers check the
//! header of the data but not its body, hence the checksum.

use std::path::{Path, PathBuf};

use ash::vk;

use super::device::DeviceInfo;
use super::instance::vulkan;
use crate::error::Result;
use crate::output::write_cache;

const MAGIC: &[u8; 8] = b"LSPIPES1";

/// A pipeline cache; saved to its file, if it has one, when dropped.
pub(super) struct PipelineCache {
    device: ash::Device,
    pub handle: vk::PipelineCache,
    path: Option<PathBuf>,
    /// Checksum of the data read, so that an unchanged cache is not written again.
    loaded: Option<u64>,
}

impl PipelineCache {
    /// # Safety
    /// The device outlives the cache.
    pub unsafe fn load(device: ash::Device, info: &DeviceInfo, path: Option<PathBuf>) -> Result<PipelineCache> {
        let data = path.as_deref().and_then(|path| read(path, info)).unwrap_or_default();
        let create = vk::PipelineCacheCreateInfo::default().initial_data(&data);
        // SAFETY: the device is valid; the data came from this driver (its header and checksum were compared).
        let handle = unsafe { device.create_pipeline_cache(&create, None) }.map_err(vulkan("vkCreatePipelineCache"))?;
        let loaded = (!data.is_empty()).then(|| fnv1a(&data));
        Ok(PipelineCache { device, handle, path, loaded })
    }

    fn save(&self, path: &Path) -> Result<()> {
        // SAFETY: the cache is alive.
        let data =
            unsafe { self.device.get_pipeline_cache_data(self.handle) }.map_err(vulkan("vkGetPipelineCacheData"))?;
        let sum = fnv1a(&data);
        if self.loaded == Some(sum) {
            return Ok(());
        }
        write_cache(path, &[&MAGIC[..], &sum.to_le_bytes(), &data].concat())
    }

    pub fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }
}

impl Drop for PipelineCache {
    fn drop(&mut self) {
        if let Some(path) = &self.path
            && let Err(error) = self.save(path)
        {
            log::warn!("pipeline cache not saved: {error}");
        }
        // SAFETY: created on this device, which is still alive; destroyed once.
        unsafe { self.device.destroy_pipeline_cache(self.handle, None) };
    }
}

/// The data of a file made by this driver for this device; any other file is ignored.
fn read(path: &Path, info: &DeviceInfo) -> Option<Vec<u8>> {
    let file = match std::fs::read(path) {
        Ok(file) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return None,
        Err(error) => {
            log::warn!("{}: pipeline cache not read: {error}", path.display());
            return None;
        }
    };
    match payload(&file, info) {
        Ok(data) => Some(data.to_vec()),
        Err(reason) => {
            log::warn!("{}: pipeline cache ignored: {reason}", path.display());
            None
        }
    }
}

fn payload<'a>(file: &'a [u8], info: &DeviceInfo) -> std::result::Result<&'a [u8], &'static str> {
    let rest = file.strip_prefix(MAGIC).ok_or("not a pipeline cache of this program")?;
    let (sum, data) = rest.split_first_chunk::<8>().ok_or("cut short")?;
    if u64::from_le_bytes(*sum) != fnv1a(data) {
        return Err("damaged");
    }
    // VkPipelineCacheHeaderVersionOne: length, version, vendor, device, UUID.
    let (header, _) = data.split_first_chunk::<32>().ok_or("cut short")?;
    let word = |i: usize| u32::from_le_bytes([header[i], header[i + 1], header[i + 2], header[i + 3]]);
    let fits = word(0) >= 32
        && word(4) == vk::PipelineCacheHeaderVersion::ONE.as_raw() as u32
        && word(8) == info.vendor_id
        && word(12) == info.device_id
        && header[16..] == info.cache_uuid;
    if fits { Ok(data) } else { Err("made by another driver or device") }
}

pub(super) fn fnv1a(data: &[u8]) -> u64 {
    data.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3))
}
