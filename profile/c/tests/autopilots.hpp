// Declarations of what the PX4 and ArduPilot examples of docs/flight-controller.md use, to compile them by themselves.
#pragma once
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>

// ---- PX4: after the files that docs/flight-controller.md lists. PX4_RELEASE is 115, 116 (1.17 is the same) or 118.
#define PX4_OK 0
#define PX4_ERROR (-1)
#define OK 0
#define __EXPORT
#define MODULE_NAME "horus_dpr"
void px4_print(const char *format, ...) __attribute__((format(printf, 1, 2)));
#define PX4_WARN(...) px4_print(__VA_ARGS__)
#define PX4_INFO(...) px4_print(__VA_ARGS__)
#define PRINT_MODULE_USAGE_NAME(name, category) px4_print("%s %s", name, category)
#define PRINT_MODULE_USAGE_COMMAND(name) px4_print("%s", name)
#define PRINT_MODULE_USAGE_PARAMS_I2C_SPI_DRIVER(i2c, spi) px4_print("%d %d", i2c, spi)
#define PRINT_MODULE_USAGE_DEFAULT_COMMANDS() px4_print("stop status")
enum spi_mode_e { SPIDEV_MODE0, SPIDEV_MODE3 };
using hrt_abstime = uint64_t;
hrt_abstime hrt_absolute_time();
struct perf_ctr_header;
using perf_counter_t = perf_ctr_header *;
enum perf_counter_type { PC_COUNT };
perf_counter_t perf_alloc(perf_counter_type type, const char *name);
void perf_count(perf_counter_t handle);
void perf_print_counter(perf_counter_t handle);
void perf_free(perf_counter_t handle);

namespace px4
{
struct wq_config_t {
};
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

class BusInstanceIterator;
struct I2CSPIDriverConfig {
    const char *module_name;
    const px4::wq_config_t &wq_config;
};
class BusCLIArguments
{
public:
    BusCLIArguments(bool i2c_support, bool spi_support);
    const char *parseDefaultArguments(int argc, char *argv[]);
    int bus_frequency{0};
    spi_mode_e spi_mode{SPIDEV_MODE3};
    int default_spi_frequency{-1};
};
class BusInstanceIterator
{
public:
    BusInstanceIterator(const char *module_name, const BusCLIArguments &cli_arguments, uint16_t devid_driver_index);
    ~BusInstanceIterator();
};

namespace device
{
class CDev
{
public:
    virtual ~CDev();
    virtual int init();
};
class SPI : public CDev
{
public:
    SPI(const SPI &) = delete;
    SPI &operator=(const SPI &) = delete;

protected:
    SPI(uint8_t device_type, const char *name, int bus, uint32_t device, enum spi_mode_e mode, uint32_t frequency);
    SPI(const I2CSPIDriverConfig &config);
    virtual ~SPI();
    int init() override;
    virtual int probe() { return PX4_OK; }
    int transfer(uint8_t *send, uint8_t *recv, unsigned len);
};
}

class I2CSPIDriverBase : public px4::ScheduledWorkItem
{
public:
    I2CSPIDriverBase(const I2CSPIDriverConfig &config) : ScheduledWorkItem(config.module_name, config.wq_config) {}
    static int module_stop(BusInstanceIterator &iterator);
    static int module_status(BusInstanceIterator &iterator);
    using instantiate_method = I2CSPIDriverBase *(*)(const I2CSPIDriverConfig &config, int runtime_instance);

protected:
    virtual ~I2CSPIDriverBase() = default;
    virtual void print_status();
    virtual void exit_and_cleanup();
    bool should_exit() const;
    static int module_start(const BusCLIArguments &cli, BusInstanceIterator &iterator, void (*print_usage)(),
        instantiate_method instantiate);
};
template <class T> class I2CSPIDriver : public I2CSPIDriverBase
{
public:
    static int module_start(const BusCLIArguments &cli, BusInstanceIterator &iterator)
    {
        return I2CSPIDriverBase::module_start(cli, iterator, &T::print_usage, &instantiate);
    }

protected:
    I2CSPIDriver(const I2CSPIDriverConfig &config) : I2CSPIDriverBase(config) {}
    virtual ~I2CSPIDriver() = default;
    void Run() final
    {
        static_cast<T *>(this)->RunImpl();
        if (should_exit()) {
            exit_and_cleanup();
        }
    }

private:
    static I2CSPIDriverBase *instantiate(const I2CSPIDriverConfig &config, int)
    {
        T *instance = new T(config);
        if (instance->init() != OK) {
            delete instance;
            return nullptr;
        }
        return instance;
    }
};

struct vehicle_global_position_s {
    uint64_t timestamp;
    uint64_t timestamp_sample;
    double lat;
    double lon;
    float alt;
    float alt_ellipsoid;
    float eph;
    float epv;
    uint8_t lat_lon_reset_counter;
#if defined(PX4_RELEASE) && PX4_RELEASE >= 116
    bool lat_lon_valid;
    bool alt_valid;
#endif
};
struct aux_global_position_s {
    uint64_t timestamp;
    uint64_t timestamp_sample;
    uint8_t id;
    uint8_t source;
    double lat;
    double lon;
    float alt;
    float eph;
    float epv;
    uint8_t lat_lon_reset_counter;
};

// A topic is of one type, and a publication of another does not compile.
#if defined(PX4_RELEASE) && PX4_RELEASE >= 118
using aux_global_position_topic = aux_global_position_s;
#else
using aux_global_position_topic = vehicle_global_position_s;
#endif
template <typename T> struct orb_metadata {
};
#define ORB_ID(name) (orb_metadata<name##_topic>{})

namespace uORB
{
template <typename T> class PublicationMulti
{
public:
    PublicationMulti(orb_metadata<T> topic);
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
uint32_t millis();
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
class AP_AHRS
{
public:
    bool handle_external_position_estimate(const Location &loc, float pos_accuracy, uint32_t timestamp_ms);
};
namespace AP
{
AP_AHRS &ahrs();
}
