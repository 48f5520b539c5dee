#pragma once
#include <openvdb/openvdb.h>

// OpenVDB's trees are templates of a thousand functions, and a file that makes a grid compiles all of them. These are
// compiled once for the tests, in vdb_grids.cpp.
extern template class openvdb::tree::Tree<openvdb::FloatTree::RootNodeType>;
extern template class openvdb::Grid<openvdb::FloatTree>;
extern template class openvdb::tree::Tree<openvdb::DoubleTree::RootNodeType>;
extern template class openvdb::Grid<openvdb::DoubleTree>;
extern template class openvdb::tree::Tree<openvdb::Vec3STree::RootNodeType>;
extern template class openvdb::Grid<openvdb::Vec3STree>;
extern template class openvdb::tree::Tree<openvdb::Vec3DTree::RootNodeType>;
extern template class openvdb::Grid<openvdb::Vec3DTree>;
