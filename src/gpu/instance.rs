//! The Vulkan instance, and the messages of its validation layer.

use std::ffi::{CStr, c_char, c_void};
use std::sync::{Arc, Mutex, PoisonError};

use ash::{ext, vk};

use crate::error::{Error, Result};

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Advice of the layer, by its words, that is not followed and so not collected: a copy out of an image may be faster in
/// TRANSFER_SRC_OPTIMAL, and one into an image in TRANSFER_DST_OPTIMAL. Images stay in GENERAL, so that one kind of barrier does for
/// everything; they are copied once.
const SILENCED_GENERAL_LAYOUT: [&str; 2] = [
    "layout should be VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL instead of GENERAL",
    "layout should be VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL instead of GENERAL",
];

/// Messages of the validation layer, kept until they are taken. Clones share the list, which outlives the context.
#[derive(Clone, Debug, Default)]
pub struct Messages(Arc<Mutex<Vec<String>>>);

impl Messages {
    /// Takes the messages received since the last call.
    pub fn take(&self) -> Vec<String> {
        // A panic while the list was locked leaves a list of whole strings, so poison means nothing here.
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Receives a message of the layer. `user_data` is the `Mutex` inside a [`Messages`].
unsafe extern "system" fn on_message(
    severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    types: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user_data: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: Vulkan passes a valid callback structure, whose strings are null or end in 0.
    let text = unsafe {
        match data.as_ref() {
            Some(data) if !data.p_message.is_null() => CStr::from_ptr(data.p_message).to_string_lossy().into_owned(),
            _ => return vk::FALSE,
        }
    };
    if !types.intersects(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION | vk::DebugUtilsMessageTypeFlagsEXT::PERFORMANCE)
    {
        // The loader's remarks on other drivers and layers of the machine say nothing about our use of Vulkan.
        log::debug!("{text}");
        return vk::FALSE;
    }
    let silenced = SILENCED_GENERAL_LAYOUT.iter().any(|advice| text.contains(advice));
    if types.contains(vk::DebugUtilsMessageTypeFlagsEXT::PERFORMANCE) && silenced {
        return vk::FALSE;
    }
    if severity.contains(vk::DebugUtilsMessageSeverityFlagsEXT::ERROR) {
        log::error!("{text}");
    } else {
        log::warn!("{text}");
    }
    // SAFETY: the instance that owns the messenger keeps the list alive until the messenger is destroyed.
    if let Some(list) = unsafe { user_data.cast::<Mutex<Vec<String>>>().as_ref() } {
        list.lock().unwrap_or_else(PoisonError::into_inner).push(text);
    }
    vk::FALSE
}

fn messenger_info(messages: &Messages) -> vk::DebugUtilsMessengerCreateInfoEXT<'static> {
    vk::DebugUtilsMessengerCreateInfoEXT::default()
        .message_severity(vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR)
        .message_type(
            vk::DebugUtilsMessageTypeFlagsEXT::GENERAL
                | vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION
                | vk::DebugUtilsMessageTypeFlagsEXT::PERFORMANCE,
        )
        .pfn_user_callback(Some(on_message))
        .user_data(Arc::as_ptr(&messages.0).cast_mut().cast())
}

/// An instance, of our own or a host's, and our messenger on it.
pub(super) struct Instance {
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    pub messages: Messages,
    pub raw: ash::Instance,
    /// VK_EXT_debug_utils is enabled.
    pub debug_utils: bool,
    owned: bool,
    /// Keeps the loader's library open.
    pub entry: ash::Entry,
}

impl Instance {
    /// Creates an instance, with the validation layer and its synchronisation checks if asked for.
    pub fn create(validation: bool) -> Result<Instance> {
        Instance::with_extensions(validation, &[])
    }

    /// The same with extensions, which a window needs.
    pub fn with_extensions(validation: bool, wanted: &[&CStr]) -> Result<Instance> {
        // SAFETY: loading the system's Vulkan loader runs its initialisers, which is what it is for.
        let entry = unsafe { ash::Entry::load() }.map_err(|e| {
            Error::NoDevice(format!("no Vulkan loader ({e}); install it (Debian: apt install libvulkan1)"))
        })?;
        // SAFETY: the entry points of a freshly loaded loader are valid, here and in the queries below.
        let version =
            unsafe { entry.try_enumerate_instance_version() }.map_err(vulkan("vkEnumerateInstanceVersion"))?;
        if version.unwrap_or(vk::API_VERSION_1_0) < vk::API_VERSION_1_1 {
            return Err(Error::NoDevice(
                "the Vulkan loader knows Vulkan 1.0 only and 1.1 is needed; install a newer one (Debian: libvulkan1)"
                    .into(),
            ));
        }
        // SAFETY: as above.
        let mut extensions = unsafe { entry.enumerate_instance_extension_properties(None) }
            .map_err(vulkan("vkEnumerateInstanceExtensionProperties"))?;
        let mut layers: Vec<*const c_char> = Vec::new();
        let mut names: Vec<*const c_char> = wanted.iter().map(|name| name.as_ptr()).collect();
        let lacks = |name: &&CStr| !extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(*name));
        if let Some(name) = wanted.iter().copied().find(lacks) {
            let message =
                format!("no Vulkan driver can show images in a window: {} is missing", name.to_string_lossy());
            return Err(Error::NoDevice(message));
        }
        if validation {
            // SAFETY: as above.
            let known = unsafe { entry.enumerate_instance_layer_properties() }
                .map_err(vulkan("vkEnumerateInstanceLayerProperties"))?;
            if !known.iter().any(|layer| layer.layer_name_as_c_str() == Ok(VALIDATION_LAYER)) {
                return Err(Error::NoDevice(
                    "no Khronos validation layer; install it (Debian: apt install vulkan-validationlayers)".into(),
                ));
            }
            layers.push(VALIDATION_LAYER.as_ptr());
            // SAFETY: as above.
            let of_layer = unsafe { entry.enumerate_instance_extension_properties(Some(VALIDATION_LAYER)) }
                .map_err(vulkan("vkEnumerateInstanceExtensionProperties"))?;
            extensions.extend(of_layer);
        }
        let has = |name: &CStr| extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(name));
        let debug_utils = has(ext::debug_utils::NAME);
        if debug_utils {
            names.push(ext::debug_utils::NAME.as_ptr());
        }
        if validation {
            if !debug_utils || !has(ext::validation_features::NAME) {
                return Err(Error::NoDevice(
                    "the Khronos validation layer is too old; install a newer one (Debian: vulkan-validationlayers)"
                        .into(),
                ));
            }
            names.push(ext::validation_features::NAME.as_ptr());
        }

        let messages = Messages::default();
        let application = vk::ApplicationInfo::default()
            .application_name(c"lightsum")
            .engine_name(c"lightsum")
            .api_version(vk::API_VERSION_1_1);
        let enables = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&enables);
        let mut messenger = messenger_info(&messages);
        let mut info = vk::InstanceCreateInfo::default()
            .application_info(&application)
            .enabled_layer_names(&layers)
            .enabled_extension_names(&names);
        if validation {
            info = info.push_next(&mut features).push_next(&mut messenger);
        }
        // SAFETY: layers and extensions were found above; everything `info` points to lives until the end of the call.
        let raw = unsafe { entry.create_instance(&info, None) }.map_err(|result| match result {
            vk::Result::ERROR_INCOMPATIBLE_DRIVER => no_driver(),
            result => vulkan("vkCreateInstance")(result),
        })?;
        let mut instance = Instance { messenger: None, messages, raw, debug_utils, owned: true, entry };
        if validation {
            instance.listen()?;
        }
        Ok(instance)
    }

    /// Wraps a host's instance. `debug_utils`: the host has enabled VK_EXT_debug_utils.
    ///
    /// # Safety
    /// The instance is valid while this lives, and `debug_utils` is true only if the extension is enabled.
    pub unsafe fn adopt(entry: ash::Entry, raw: ash::Instance, debug_utils: bool) -> Result<Instance> {
        let mut instance =
            Instance { messenger: None, messages: Messages::default(), raw, debug_utils, owned: false, entry };
        if debug_utils {
            instance.listen()?;
        }
        Ok(instance)
    }

    /// Creates the messenger. VK_EXT_debug_utils is enabled.
    fn listen(&mut self) -> Result<()> {
        let functions = ext::debug_utils::Instance::new(&self.entry, &self.raw);
        // SAFETY: the extension is enabled, and `self.messages` outlives the messenger (see `drop`).
        let messenger = unsafe { functions.create_debug_utils_messenger(&messenger_info(&self.messages), None) }
            .map_err(vulkan("vkCreateDebugUtilsMessengerEXT"))?;
        self.messenger = Some((functions, messenger));
        Ok(())
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        if let Some((functions, messenger)) = self.messenger.take() {
            // SAFETY: created by `listen` on this instance, destroyed once.
            unsafe { functions.destroy_debug_utils_messenger(messenger, None) };
        }
        if self.owned {
            // SAFETY: all that was created from the instance is gone: the context drops this last.
            unsafe { self.raw.destroy_instance(None) };
        }
    }
}

/// Remedy if the loader finds no driver.
pub(super) fn no_driver() -> Error {
    Error::NoDevice(
        "no Vulkan driver; install the one of your GPU, or Mesa's for the processor (Debian: apt install \
         mesa-vulkan-drivers)"
            .into(),
    )
}

/// For `map_err`: the error of the Vulkan call `what`.
pub(super) fn vulkan(what: &str) -> impl FnOnce(vk::Result) -> Error + use<> {
    let what = what.to_owned();
    move |result| match result {
        vk::Result::ERROR_DEVICE_LOST => Error::DeviceLost { during: what },
        vk::Result::ERROR_OUT_OF_HOST_MEMORY | vk::Result::ERROR_OUT_OF_DEVICE_MEMORY => {
            Error::OutOfMemory { resource: what, bytes: None }
        }
        result => Error::Vulkan { what, result },
    }
}
