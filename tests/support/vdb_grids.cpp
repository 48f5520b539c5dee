#include "tests/support/vdb_grids.h"

template class openvdb::tree::Tree<openvdb::FloatTree::RootNodeType>;
template class openvdb::Grid<openvdb::FloatTree>;
template class openvdb::tree::Tree<openvdb::DoubleTree::RootNodeType>;
template class openvdb::Grid<openvdb::DoubleTree>;
template class openvdb::tree::Tree<openvdb::Vec3STree::RootNodeType>;
template class openvdb::Grid<openvdb::Vec3STree>;
template class openvdb::tree::Tree<openvdb::Vec3DTree::RootNodeType>;
template class openvdb::Grid<openvdb::Vec3DTree>;
