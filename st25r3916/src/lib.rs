//! Driver for ST's ST25R3916 and ST25R3916B NFC front ends: NFC-F poller and listener
