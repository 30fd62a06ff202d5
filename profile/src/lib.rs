//! The HORUS profile: packed, CRC-protected objects, their air frames and the DPR image
