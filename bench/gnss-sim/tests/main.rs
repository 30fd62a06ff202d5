mod configuration;
mod flight;
mod log;
mod messages;
mod receiver;
