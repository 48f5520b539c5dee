#include "app/command.h"
namespace brume::app {
void add_filters(CLI::App&, Common&, Commands&) {}
}
