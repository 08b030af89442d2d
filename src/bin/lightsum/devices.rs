//! `lightsum devices`: the Vulkan devices of this machine.

use lightsum::{Error, Result, gpu};
use serde_json::{Value, json};

use crate::say;

/// Prints them: one line each with index, name and the properties that help to choose, or JSON.
pub fn run(as_json: bool) -> Result<()> {
    let devices = gpu::list_devices()?;
    let kind = |device: &gpu::DeviceInfo| format!("{:?}", device.device_type).to_lowercase().replace('_', " ");
    if as_json {
        let all: Vec<Value> = (devices.iter())
            .map(|device| {
                json!({
                    "index": device.index,
                    "name": device.name,
                    "type": kind(device),
                    "driver": device.driver,
                    "driver_version": device.driver_version,
                    "api_version": device.api_version,
                    "subgroup_size": device.subgroup_size,
                    "missing": device.missing,
                })
            })
            .collect();
        let text = serde_json::to_string_pretty(&all).map_err(|e| Error::NoDevice(e.to_string()))?;
        say(&text);
        return Ok(());
    }
    for device in devices {
        let driver = [device.driver.as_str(), device.driver_version.as_str()].join(" ");
        let (kind, driver, api, subgroup) = (kind(&device), driver.trim(), &device.api_version, device.subgroup_size);
        let mut line =
            format!("{}  {}  ({kind}; {driver}; Vulkan {api}; subgroups of {subgroup})", device.index, device.name);
        if !device.missing.is_empty() {
            line += &format!("  cannot be used: it lacks {}", device.missing.join(", "));
        }
        say(&line);
    }
    Ok(())
}
