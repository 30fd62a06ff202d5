//! Firmware of the DPR: NFC-F frames in, an active dual-ported RAM read over SSI
