//! Devices: enumeration, limits, choice, and the requirements for a host's device.

use std::ffi::CStr;
use std::str::FromStr;

use ash::{khr, vk};

use super::instance::{Instance, no_driver, vulkan};
use super::kernel::texel_format;
use crate::error::{Error, Result};

/// A device and the limits that matter here.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceInfo {
    /// Index in Vulkan's list, as for `--device`.
    pub index: usize,
    /// Name of the device.
    pub name: String,
    /// Name of the driver; empty if unknown.
    pub driver: String,
    /// Version of the driver, in its own format.
    pub driver_version: String,
    /// Version of Vulkan, such as "1.3.230".
    pub api_version: String,
    /// Discrete, integrated, virtual, CPU.
    pub device_type: vk::PhysicalDeviceType,
    /// Invocations of a subgroup.
    pub subgroup_size: u32,
    /// Subgroup operations available to compute shaders.
    pub subgroup_operations: vk::SubgroupFeatureFlags,
    /// Maximum size of a storage buffer binding, bytes.
    pub max_storage_buffer_range: u64,
    /// Maximum number of storage buffers of one kernel.
    pub max_storage_buffers: u32,
    /// Maximum size of one allocation, bytes.
    pub max_allocation: u64,
    /// Maximum number of workgroups along each axis of a dispatch.
    pub max_workgroup_count: [u32; 3],
    /// Maximum size of a workgroup along each axis.
    pub max_workgroup_size: [u32; 3],
    /// Maximum number of invocations of a workgroup.
    pub max_workgroup_invocations: u32,
    /// Memory shared by a workgroup, bytes.
    pub max_workgroup_memory: u32,
    /// Maximum size of push constants, bytes.
    pub max_push_bytes: u32,
    /// Maximum width and height of an image, pixels.
    pub max_image_dimension: u32,
    /// Maximum number of sampled images and texel buffers of one kernel.
    pub max_sampled_images: u32,
    /// Maximum number of storage images and texel buffers that one kernel writes.
    pub max_storage_images: u32,
    /// Kernels take arrays as texel buffers: the driver runs on the processor, and takes any storage buffer as one.
    pub texel_buffers: bool,
    /// Memory of the device itself, bytes.
    pub device_memory: u64,
    /// Nanoseconds of one timestamp tick.
    pub timestamp_period: f32,
    /// Whether the compute queue writes timestamps.
    pub timestamps: bool,
    /// Requirements of this library that the device lacks; empty if it can be used.
    pub missing: Vec<String>,
    pub(super) vendor_id: u32,
    pub(super) device_id: u32,
    pub(super) cache_uuid: [u8; vk::UUID_SIZE],
}

impl DeviceInfo {
    /// Queries a device. `index` is its position in Vulkan's list.
    ///
    /// # Safety
    /// The physical device belongs to the instance, which asked for Vulkan 1.1 or later.
    pub(super) unsafe fn query(instance: &ash::Instance, physical: vk::PhysicalDevice, index: usize) -> DeviceInfo {
        // SAFETY: the caller's promise; the 1.1 query is made of 1.1 devices only.
        let (core, family, memory) = unsafe {
            (
                instance.get_physical_device_properties(physical),
                compute_family(instance, physical),
                instance.get_physical_device_memory_properties(physical),
            )
        };
        let limits = &core.limits;
        let mut missing = Vec::new();
        if family.is_none() {
            missing.push("a compute queue".to_owned());
        }
        missing.extend(missing_storage_buffers(limits));
        let mut subgroup = vk::PhysicalDeviceSubgroupProperties::default();
        let mut maintenance = vk::PhysicalDeviceMaintenance3Properties::default();
        let mut driver = vk::PhysicalDeviceDriverProperties::default();
        if core.api_version < vk::API_VERSION_1_1 {
            missing.push("Vulkan 1.1".to_owned());
        } else {
            // SAFETY: as above. Properties of an extension may be asked for where the device lists it.
            unsafe {
                let extensions = instance.enumerate_device_extension_properties(physical).unwrap_or_default();
                let mut all =
                    vk::PhysicalDeviceProperties2::default().push_next(&mut subgroup).push_next(&mut maintenance);
                if extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(khr::driver_properties::NAME)) {
                    all = all.push_next(&mut driver);
                }
                instance.get_physical_device_properties2(physical, &mut all);
            }
        }
        let told = |text: std::result::Result<&CStr, _>| text.map(|t: &CStr| t.to_string_lossy().into_owned());
        let version =
            |v| format!("{}.{}.{}", vk::api_version_major(v), vk::api_version_minor(v), vk::api_version_patch(v));
        let driver_version =
            told(driver.driver_info_as_c_str()).ok().filter(|text| !text.is_empty()).unwrap_or_else(|| {
                // Without the driver's own words the number is shown as it came: its parts differ by vendor.
                format!("{:#x}", core.driver_version)
            });
        DeviceInfo {
            index,
            name: told(core.device_name_as_c_str()).unwrap_or_default(),
            driver: told(driver.driver_name_as_c_str()).unwrap_or_default(),
            driver_version,
            api_version: version(core.api_version),
            device_type: core.device_type,
            subgroup_size: subgroup.subgroup_size,
            subgroup_operations: if subgroup.supported_stages.contains(vk::ShaderStageFlags::COMPUTE) {
                subgroup.supported_operations
            } else {
                vk::SubgroupFeatureFlags::empty()
            },
            max_storage_buffer_range: u64::from(limits.max_storage_buffer_range),
            max_storage_buffers: storage_buffers(limits),
            max_allocation: maintenance.max_memory_allocation_size,
            max_workgroup_count: limits.max_compute_work_group_count,
            max_workgroup_size: limits.max_compute_work_group_size,
            max_workgroup_invocations: limits.max_compute_work_group_invocations,
            max_workgroup_memory: limits.max_compute_shared_memory_size,
            max_push_bytes: limits.max_push_constants_size,
            max_image_dimension: limits.max_image_dimension2_d,
            max_sampled_images: limits
                .max_per_stage_descriptor_sampled_images
                .min(limits.max_descriptor_set_sampled_images),
            max_storage_images: limits
                .max_per_stage_descriptor_storage_images
                .min(limits.max_descriptor_set_storage_images),
            texel_buffers: core.device_type == vk::PhysicalDeviceType::CPU
                && limits.max_storage_buffer_range / 4 <= limits.max_texel_buffer_elements
                // SAFETY: the caller's promise.
                && unsafe { takes_texels(instance, physical) },
            device_memory: memory
                .memory_heaps_as_slice()
                .iter()
                .filter(|heap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL))
                .map(|heap| heap.size)
                .sum(),
            timestamp_period: limits.timestamp_period,
            timestamps: family.is_some_and(|(_, bits)| bits > 0),
            missing,
            vendor_id: core.vendor_id,
            device_id: core.device_id,
            cache_uuid: core.pipeline_cache_uuid,
        }
    }

    /// Whether transfers take memory of the device.
    pub(super) fn is_unified(&self) -> bool {
        matches!(self.device_type, vk::PhysicalDeviceType::CPU | vk::PhysicalDeviceType::INTEGRATED_GPU)
    }

    /// Whether some hundred or thousand invocations leave most of the device idle, so that a workgroup takes what an invocation takes
    /// elsewhere. Drivers on the processor are narrow, unless they are to be used as graphics cards
    /// ([`ContextOptions::no_texel_buffers`](super::ContextOptions::no_texel_buffers)).
    pub fn is_wide(&self) -> bool {
        !self.texel_buffers
    }

    /// Memory that is free now, bytes: of a processor what the system can give without swapping, whatever the driver tells (lavapipe of Mesa 22.3 says
    /// 2 GiB, and gives more); of other devices all.
    pub(super) fn free_memory(&self) -> u64 {
        match self.device_type {
            vk::PhysicalDeviceType::CPU => crate::input::free_memory(),
            _ => self.device_memory,
        }
    }

    /// The device, its driver and the width of its subgroups in one line: renderings by the same one have the same bits.
    pub fn identity(&self) -> String {
        let DeviceInfo { name, driver, driver_version, subgroup_size, .. } = self;
        format!("{name}, {driver} {driver_version}, subgroups of {subgroup_size}")
    }

    fn line(&self) -> String {
        format!("{}: {} ({} {})", self.index, self.name, self.driver, self.driver_version)
    }
}

/// Whether buffers of the formats that kernels use can be read as texels, and but for texels of two words written.
///
/// # Safety
/// The physical device belongs to the instance.
unsafe fn takes_texels(instance: &ash::Instance, physical: vk::PhysicalDevice) -> bool {
    [4, 8, 16].map(texel_format).into_iter().all(|format| {
        // SAFETY: the caller's promise.
        let properties = unsafe { instance.get_physical_device_format_properties(physical, format) };
        let read = vk::FormatFeatureFlags::UNIFORM_TEXEL_BUFFER;
        let written = vk::FormatFeatureFlags::STORAGE_TEXEL_BUFFER;
        properties.buffer_features.contains(if format == texel_format(8) { read } else { read | written })
    })
}

/// Maximum number of storage buffers of a kernel: the minimum of Vulkan's limits on them.
fn storage_buffers(limits: &vk::PhysicalDeviceLimits) -> u32 {
    limits.max_per_stage_descriptor_storage_buffers.min(limits.max_descriptor_set_storage_buffers)
}

/// The missing requirement of a device that allows fewer storage buffers than our kernels declare.
fn missing_storage_buffers(limits: &vk::PhysicalDeviceLimits) -> Option<String> {
    let has = storage_buffers(limits);
    let wanted = super::shaders::ALL.iter().map(|shader| shader.storage_buffers()).max().unwrap_or(0);
    (has < wanted).then(|| {
        format!("room for {wanted} storage buffers in a kernel (maxPerStageDescriptorStorageBuffers is {has})")
    })
}

/// A queue family with compute, and the valid bits of its timestamps; preferably one that writes timestamps.
///
/// # Safety
/// The physical device belongs to the instance.
pub(super) unsafe fn compute_family(instance: &ash::Instance, physical: vk::PhysicalDevice) -> Option<(u32, u32)> {
    // SAFETY: the caller's promise.
    let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
    let compute = || {
        (0u32..)
            .zip(&families)
            .filter(|(_, family)| family.queue_flags.contains(vk::QueueFlags::COMPUTE))
            .map(|(index, family)| (index, family.timestamp_valid_bits))
    };
    compute().find(|(_, bits)| *bits > 0).or_else(|| compute().next())
}

/// The devices of this machine in Vulkan's order, including unusable ones.
pub fn list_devices() -> Result<Vec<DeviceInfo>> {
    Ok(enumerate(&Instance::create(false)?)?.into_iter().map(|(_, info)| info).collect())
}

pub(super) fn enumerate(instance: &Instance) -> Result<Vec<(vk::PhysicalDevice, DeviceInfo)>> {
    // SAFETY: the instance is alive and was created for Vulkan 1.1; the handles come from it.
    let devices = unsafe { instance.raw.enumerate_physical_devices() }.map_err(|result| match result {
        vk::Result::ERROR_INITIALIZATION_FAILED => no_driver(),
        result => vulkan("vkEnumeratePhysicalDevices")(result),
    })?;
    let describe = |(index, physical)| {
        // SAFETY: as above.
        (physical, unsafe { DeviceInfo::query(&instance.raw, physical, index) })
    };
    Ok(devices.into_iter().enumerate().map(describe).collect())
}

/// Which device to render on.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum DeviceChoice {
    /// In order of preference: a discrete GPU, an integrated one, a virtual one, the CPU.
    #[default]
    Auto,
    /// Index in the list of devices.
    Index(usize),
    /// Part of the device's name; case does not matter.
    Name(String),
    /// A driver that runs on the CPU.
    Cpu,
}

impl FromStr for DeviceChoice {
    type Err = Error;

    fn from_str(text: &str) -> Result<DeviceChoice> {
        let text = text.trim();
        if text.is_empty() {
            return Err(Error::Setting {
                name: "device",
                message: "give an index of --list-devices, a part of a name, or cpu".into(),
            });
        }
        Ok(match (text.to_lowercase().as_str(), text.parse()) {
            ("auto", _) => DeviceChoice::Auto,
            ("cpu", _) => DeviceChoice::Cpu,
            (_, Ok(index)) => DeviceChoice::Index(index),
            (_, Err(_)) => DeviceChoice::Name(text.to_owned()),
        })
    }
}

impl DeviceChoice {
    /// Picks from the list; an unusable device is never picked silently.
    pub fn pick(&self, devices: &[DeviceInfo]) -> Result<usize> {
        if devices.is_empty() {
            return Err(no_driver());
        }
        let usable = |device: &&DeviceInfo| device.missing.is_empty();
        let found = match self {
            DeviceChoice::Auto => devices.iter().filter(usable).min_by_key(|device| match device.device_type {
                vk::PhysicalDeviceType::DISCRETE_GPU => 0,
                vk::PhysicalDeviceType::INTEGRATED_GPU => 1,
                vk::PhysicalDeviceType::VIRTUAL_GPU => 2,
                vk::PhysicalDeviceType::CPU => 3,
                _ => 4,
            }),
            DeviceChoice::Index(index) => devices.get(*index),
            DeviceChoice::Name(name) => {
                let name = name.to_lowercase();
                let named = || devices.iter().filter(|device| device.name.to_lowercase().contains(&name));
                named().find(usable).or_else(|| named().next())
            }
            DeviceChoice::Cpu => {
                devices.iter().filter(usable).find(|device| device.device_type == vk::PhysicalDeviceType::CPU)
            }
        };
        match found {
            Some(device) if device.missing.is_empty() => Ok(device.index),
            Some(device) => {
                Err(Error::NoDevice(format!("device {} lacks {}", device.line(), device.missing.join(" and "))))
            }
            None => {
                let wanted = match self {
                    DeviceChoice::Auto => "no device can be used".to_owned(),
                    DeviceChoice::Index(index) => format!("there is no device {index}"),
                    DeviceChoice::Name(name) => format!("no device has {name:?} in its name"),
                    DeviceChoice::Cpu => {
                        "no driver runs on the processor (Debian: apt install mesa-vulkan-drivers)".to_owned()
                    }
                };
                let list: Vec<String> = devices.iter().map(|device| format!("\n  {}", device.line())).collect();
                Err(Error::NoDevice(format!("{wanted}; the devices are{}", list.concat())))
            }
        }
    }
}

/// Requirements for a host's device, to be checked before the device is created.
#[non_exhaustive]
#[derive(Clone, Debug)]
pub struct Requirements {
    /// Minimum Vulkan version that the host's instance must request (`VkApplicationInfo::apiVersion`).
    pub api_version: u32,
    /// Device extensions to enable. At present none; a host that appends this list keeps working if that changes.
    pub extensions: Vec<&'static CStr>,
    /// Features to enable. At present none.
    pub features: vk::PhysicalDeviceFeatures,
    /// A suitable queue family, if there is one. Any other with compute is suitable too.
    pub queue_family: Option<u32>,
    /// Requirements that the device lacks; empty if it can be used.
    pub missing: Vec<String>,
}

impl Requirements {
    /// Checks a device.
    ///
    /// # Safety
    /// The physical device belongs to the instance, which belongs to the entry.
    pub unsafe fn check(entry: &ash::Entry, instance: &ash::Instance, physical: vk::PhysicalDevice) -> Requirements {
        // SAFETY: the caller's promise.
        let (loader, family, properties) = unsafe {
            (
                entry.try_enumerate_instance_version().ok().flatten().unwrap_or(vk::API_VERSION_1_0),
                compute_family(instance, physical),
                instance.get_physical_device_properties(physical),
            )
        };
        let mut missing = Vec::new();
        if loader < vk::API_VERSION_1_1 {
            missing.push("a Vulkan loader of version 1.1".to_owned());
        }
        if properties.api_version < vk::API_VERSION_1_1 {
            missing.push("Vulkan 1.1".to_owned());
        }
        if family.is_none() {
            missing.push("a compute queue".to_owned());
        }
        missing.extend(missing_storage_buffers(&properties.limits));
        Requirements {
            api_version: vk::API_VERSION_1_1,
            extensions: Vec::new(),
            features: vk::PhysicalDeviceFeatures::default(),
            queue_family: family.map(|(index, _)| index),
            missing,
        }
    }

    /// Appends the required extensions to those of the host.
    pub fn add_to(&self, extensions: &mut Vec<&'static CStr>) {
        for extension in &self.extensions {
            if !extensions.contains(extension) {
                extensions.push(extension);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_with_few_storage_buffers_is_told_so() {
        let limits = |per_stage, per_set| vk::PhysicalDeviceLimits {
            max_per_stage_descriptor_storage_buffers: per_stage,
            max_descriptor_set_storage_buffers: per_set,
            ..vk::PhysicalDeviceLimits::default()
        };
        assert_eq!(missing_storage_buffers(&limits(64, 64)), None);
        // 4 and 24 are guaranteed by Vulkan 1.1.
        let missing = missing_storage_buffers(&limits(4, 24)).unwrap();
        assert!(missing.contains("storage buffers") && missing.ends_with("is 4)"), "{missing}");
    }
}
