// Declarations of what the PX4 and ArduPilot examples of docs/flight-controller.md use, to compile them by themselves.
#pragma once
#include <cmath>
#include <cstddef>
#include <cstdint>

// ---- PX4
#define PX4_OK 0
#define PX4_ERROR (-1)
void px4_warn(const char *format, ...) __attribute__((format(printf, 1, 2)));
#define PX4_WARN(...) px4_warn(__VA_ARGS__)
#define ORB_ID(name) #name
enum spi_mode_e { SPIDEV_MODE0 };
uint64_t hrt_absolute_time();

namespace device
{
class SPI
{
public:
    SPI(const char *name, const char *devname, int bus, uint32_t device, spi_mode_e mode, uint32_t frequency);
    virtual ~SPI();
    virtual int init();
    int transfer(uint8_t *send, uint8_t *recv, unsigned len);
};
}

namespace px4
{
struct wq_config_t {
};
namespace wq_configurations
{
extern const wq_config_t nav_and_controllers;
}
class ScheduledWorkItem
{
public:
    ScheduledWorkItem(const char *name, const wq_config_t &config);
    virtual ~ScheduledWorkItem();
    void ScheduleOnInterval(uint32_t interval_us, uint32_t delay_us = 0);

private:
    virtual void Run() = 0;
};
}

struct vehicle_global_position_s {
    uint64_t timestamp;
    uint64_t timestamp_sample;
    double lat;
    double lon;
    float alt;
    float alt_ellipsoid;
    bool lat_lon_valid;
    bool alt_valid;
};

namespace uORB
{
template <typename T> class PublicationMulti
{
public:
    PublicationMulti(const char *topic);
    bool publish(const T &data);
};
}

// ---- ArduPilot
struct Location {
    int32_t alt;
    int32_t lat;
    int32_t lng;
};
struct HAL_Semaphore {
    void take();
    void give();
};
struct WithSemaphore {
    explicit WithSemaphore(HAL_Semaphore &semaphore);
    ~WithSemaphore();
};
#define WITH_SEMAPHORE(semaphore) WithSemaphore with_semaphore(semaphore)

namespace AP_HAL
{
using Callback = void (*)(void *);
uint64_t micros64();
class SPIDevice
{
public:
    virtual ~SPIDevice();
    virtual bool transfer_fullduplex(const uint8_t *send, uint8_t *recv, uint32_t len) = 0;
    template <typename F> void *register_periodic_callback(uint32_t, F callback)
    {
        callback();
        return nullptr;
    }
};
}
template <typename T> auto functor_bind(T *object, void (T::*method)())
{
    return [object, method]() { (object->*method)(); };
}
#define FUNCTOR_BIND_MEMBER(method, result) functor_bind(this, method)
