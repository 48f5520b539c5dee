#include "app/command.h"
namespace brume::app {
void add_denoise(CLI::App&, Common&, Commands&) {}
}
