/* Runs an exported FMU (FMI 2.0, co-simulation) in the C importer of the Reference FMUs.
 *
 *     git clone https://github.com/modelica/Reference-FMUs
 *     gcc -DFMI_VERSION=2 -I Reference-FMUs/include benchmarks/fmu_import.c Reference-FMUs/src/FMI.c \
 *         Reference-FMUs/src/FMI2.c -ldl -lm -o fmu_import
 *     hil-bench export-fmu axis.fmu && unzip -q axis.fmu -d axis
 *     LD_PRELOAD=libpython3.x.so ./fmu_import axis IDENTIFIER GUID STEPS STEP [VR=VALUE ...] [VR ...]
 *
 * IDENTIFIER, GUID and value references are those of modelDescription.xml. It sets each VR=VALUE, makes
 * STEPS steps of STEP seconds and prints each VR; the exit code is the FMU's worst status.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "FMI2.h"

#define TRY(call) do { status = (call); if (status > FMIWarning) goto end; } while (0)

static void say(FMIInstance *instance, FMIStatus status, const char *category, const char *message) {
    (void)instance;
    fprintf(stderr, "%d %s: %s\n", status, category, message);
}

int main(int argc, char *argv[]) {
    char library[4096], uri[4096];
    FMIStatus status = FMIError;
    if (argc < 6) {
        fprintf(stderr, "give FOLDER IDENTIFIER GUID STEPS STEP [VR=VALUE ...] [VR ...]\n");
        return 2;
    }
    const char *folder = realpath(argv[1], NULL);
    const long steps = atol(argv[4]);
    const double step = atof(argv[5]);
    FMIInstance *fmu = FMICreateInstance("axis", say, NULL);
    if (folder == NULL || fmu == NULL) {
        return 2;
    }
    TRY(FMIPlatformBinaryPath(folder, argv[2], FMIMajorVersion2, library, sizeof library));
    TRY(FMILoadPlatformBinary(fmu, library));
    snprintf(uri, sizeof uri, "file://%s/resources", folder);
    TRY(FMI2Instantiate(fmu, uri, fmi2CoSimulation, argv[3], fmi2False, fmi2False));
    TRY(FMI2SetupExperiment(fmu, fmi2False, 0.0, 0.0, fmi2True, steps * step));
    TRY(FMI2EnterInitializationMode(fmu));
    for (int i = 6; i < argc; i++) {
        const char *equals = strchr(argv[i], '=');
        if (equals != NULL) {
            const fmi2ValueReference reference = (fmi2ValueReference)atoi(argv[i]);
            const fmi2Real value = atof(equals + 1);
            TRY(FMI2SetReal(fmu, &reference, 1, &value));
        }
    }
    TRY(FMI2ExitInitializationMode(fmu));
    for (long number = 0; number < steps; number++) {
        TRY(FMI2DoStep(fmu, number * step, step, fmi2True));
    }
    for (int i = 6; i < argc; i++) {
        if (strchr(argv[i], '=') == NULL) {
            const fmi2ValueReference reference = (fmi2ValueReference)atoi(argv[i]);
            fmi2Real value;
            TRY(FMI2GetReal(fmu, &reference, 1, &value));
            printf("%u %.17g\n", reference, value);
        }
    }
    TRY(FMI2Terminate(fmu));
    FMI2FreeInstance(fmu);
end:
    fprintf(stderr, "status %d\n", status);
    return status;
}
