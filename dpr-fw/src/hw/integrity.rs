//! The image that the flight controller reads at present. The idle loop verifies it through this module.

use core::sync::atomic::{AtomicU32, Ordering};

use dpr_fw::{integrity::Shown, ImageMemory, IMAGE_WORDS};
use firmware_common::memory;

/// The address of the image buffer that the SSI streams; 0 before the first image.
static ADDRESS: AtomicU32 = AtomicU32::new(0);
/// The number of images that the SSI has streamed so far. When it wraps, it skips 0.
static GENERATION: AtomicU32 = AtomicU32::new(0);

/// Records that the SSI task has taken another image. This must be called before the buffer of the previous image can
/// be scrubbed. If a reader finds the same generation before and after its reads, all of them were from one image.
#[inline]
pub(super) fn shown(image: &ImageMemory) {
    ADDRESS.store(image.as_ptr() as u32, Ordering::Relaxed);
    // The count skips 0, which means that there was no image yet.
    let next = GENERATION.load(Ordering::Relaxed).wrapping_add(1).max(1);
    GENERATION.store(next, Ordering::Release);
}

#[derive(Clone, Copy)]
pub(crate) struct ShownImage;

impl Shown for ShownImage {
    fn generation(&self) -> u32 {
        GENERATION.load(Ordering::SeqCst)
    }

    /// Loads the words in assembly, because a reference would promise that no other task changes them.
    fn copy(&self, first: usize, words: &mut [u32]) {
        let image = ADDRESS.load(Ordering::Relaxed);
        for (word, index) in words.iter_mut().zip(first..IMAGE_WORDS) {
            *word = memory::load(image + 4 * index as u32);
        }
    }
}
