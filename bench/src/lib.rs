//! Both firmware images on an emulated pair of MCUs, with the air between them
