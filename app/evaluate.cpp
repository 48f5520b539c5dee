#include "app/command.h"
namespace brume::app {
void add_evaluate(CLI::App&, Common&, Commands&) {}
}
