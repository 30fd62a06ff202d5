//! Firmware of the HORUS side: three GNSS receivers in, one NFC-F frame out every 10 ms
