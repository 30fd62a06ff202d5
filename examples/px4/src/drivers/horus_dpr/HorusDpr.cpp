/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/*
 * HORUS's position for EKF2, as an auxiliary global position: the module reads the DPR 250 times a second and publishes
 * each sample that is fresh and valid. Without one the topic stops, and EKF2 continues with the GNSS.
 */
#include <px4_platform_common/px4_config.h>
#include <px4_platform_common/i2c_spi_buses.h>
#include <px4_platform_common/module.h>
#include <drivers/device/spi.h>
#include <drivers/drv_hrt.h>
#include <lib/perf/perf_counter.h>
#include <uORB/PublicationMulti.hpp>
#include <uORB/topics/vehicle_global_position.h>
#if __has_include(<uORB/topics/aux_global_position.h>)
#include <uORB/topics/aux_global_position.h>
/* These releases have a separate message for the topic. */
using Position = aux_global_position_s;
#else
/* PX4 1.15 to 1.17: the topic has the type of the vehicle's own position. */
using Position = vehicle_global_position_s;
#endif

#include "horus_dpr.h"

namespace
{
constexpr uint32_t CYCLE_US = 4000;
constexpr uint32_t SPI_HZ = 2000000;
constexpr uint8_t RECEIVERS = 3;
/* PX4 has no device type for it; on an external bus the type has no effect. */
constexpr uint16_t DEVICE_TYPE = 0xFF;

/* Fields that only some releases have. */
template <typename T> auto mark_valid(T &position, int) -> decltype(position.lat_lon_valid, void())
{
    position.lat_lon_valid = true;
    position.alt_valid = false;
}
template <typename T> void mark_valid(T &, long) {}
template <typename T> auto set_ellipsoid(T &position, float metres, int) -> decltype(position.alt_ellipsoid, void())
{
    position.alt_ellipsoid = metres;
}
template <typename T> void set_ellipsoid(T &, float, long) {}
template <typename T> auto set_source(T &position, int) -> decltype(position.id, void())
{
    position.id = 1;
}
template <typename T> void set_source(T &, long) {}
}

class HorusDpr : public device::SPI, public I2CSPIDriver<HorusDpr>
{
public:
    explicit HorusDpr(const I2CSPIDriverConfig &config) : SPI(config), I2CSPIDriver(config) {}
    ~HorusDpr() override { perf_free(_failed); }

    static void print_usage();

    int init() override
    {
        const horus_dpr_config_t config = horus_dpr_config(RECEIVERS);
        if (horus_dpr_init(&_dpr, &config) != HORUS_DPR_OK) {
            return PX4_ERROR;
        }
        const int opened = SPI::init();
        if (opened == PX4_OK) {
            ScheduleOnInterval(CYCLE_US);
        }
        return opened;
    }

    void RunImpl()
    {
        const hrt_abstime began_us = hrt_absolute_time();
        size_t bytes = horus_dpr_begin(&_dpr, _buffer, sizeof(_buffer));
        if (transfer(_buffer, _buffer, static_cast<unsigned>(bytes)) != PX4_OK) {
            perf_count(_failed);
            bytes = 0;
        }
        horus_dpr_report_t report;
        horus_dpr_end(&_dpr, _buffer, bytes, began_us, HORUS_DPR_NO_FRESH, &report);

        if (report.has_position && report.verdict == HORUS_DPR_FRESH) {
            Position position{};
            position.timestamp_sample = began_us - report.age_us;
            position.lat = report.position.latitude;
            position.lon = report.position.longitude;
            /* HORUS's height is above the ellipsoid, this one above the mean sea level. */
            position.alt = NAN;
            set_ellipsoid(position, static_cast<float>(report.position.altitude), 0);
            mark_valid(position, 0);
            set_source(position, 0);
            /* HORUS gives no accuracy, so EKF2's noise parameter is used. */
            position.eph = 0.0F;
            position.epv = 0.0F;
            position.timestamp = hrt_absolute_time();
            _position_pub.publish(position);
        }
        if (report.has_position != _had_position) {
            _had_position = report.has_position;
            PX4_WARN("position %s, verdict %d", _had_position ? "there" : "lost", static_cast<int>(report.verdict));
        }
        _verdict = report.verdict;
    }

    void print_status() override
    {
        I2CSPIDriverBase::print_status();
        perf_print_counter(_failed);
        PX4_INFO("position %s, verdict %d", _had_position ? "there" : "none", static_cast<int>(_verdict));
    }

private:
    horus_dpr_t _dpr{};
    uint8_t _buffer[HORUS_DPR_MAX_MAP_BYTES]{};
    horus_dpr_verdict_t _verdict{HORUS_DPR_SILENT};
    bool _had_position{false};
    uORB::PublicationMulti<Position> _position_pub{ORB_ID(aux_global_position)};
    perf_counter_t _failed{perf_alloc(PC_COUNT, MODULE_NAME": transfer failed")};
};

void HorusDpr::print_usage()
{
    PRINT_MODULE_USAGE_NAME("horus_dpr", "driver");
    PRINT_MODULE_USAGE_COMMAND("start");
    PRINT_MODULE_USAGE_PARAMS_I2C_SPI_DRIVER(false, true);
    PRINT_MODULE_USAGE_DEFAULT_COMMANDS();
}

extern "C" __EXPORT int horus_dpr_main(int argc, char *argv[])
{
    BusCLIArguments cli{false, true};
    cli.default_spi_frequency = SPI_HZ;
    cli.spi_mode = SPIDEV_MODE0;

    const char *verb = cli.parseDefaultArguments(argc, argv);
    if (verb == nullptr) {
        HorusDpr::print_usage();
        return -1;
    }
    BusInstanceIterator iterator(MODULE_NAME, cli, DEVICE_TYPE);
    if (strcmp(verb, "start") == 0) {
        return HorusDpr::module_start(cli, iterator);
    }
    if (strcmp(verb, "stop") == 0) {
        return HorusDpr::module_stop(iterator);
    }
    if (strcmp(verb, "status") == 0) {
        return HorusDpr::module_status(iterator);
    }
    HorusDpr::print_usage();
    return -1;
}
