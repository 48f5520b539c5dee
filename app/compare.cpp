#include "app/command.h"
namespace brume::app {
void add_compare(CLI::App&, Common&, Commands&) {}
}
